"""Evaluate learned light without a renderer: python examples/evaluate_baked_light.py [OUT]

Reads OUT/scene.glb (see bake_a_room.py) and prints the learned radiance of a grey, matt floor (y = 0) below the light's
box, seen from above.
"""

import sys
from pathlib import Path

import numpy as np

from lightwell.asset import read_fields
from lightwell.graph import evaluate

fields, variables = read_fields(Path(sys.argv[1] if len(sys.argv) > 1 else "out/two-rooms") / "scene.glb")
light = variables[0]
if light["kind"] != "point":
    sys.exit(f"'{light['name']}' is a {light['kind']}; this example wants a bake with a point light")

# Five points in a row, and what a field may know of each; an input of one row is shared by all points.
low, high = np.float32(light["low"]), np.float32(light["high"])
position = np.linspace(low, high, 5, dtype=np.float32)
position[:, 1:] = 0.0, (low[2] + high[2]) / 2
reflectance = np.float32([[0.5, 0.5, 0.5]])
inputs = {
    "position": position,
    "normal": np.float32([[0, 1, 0]]),
    "view": np.float32([[0, 1, 0]]),
    "light": np.float32([light["initial"]]),
    "reflectance": reflectance,
    "roughness": np.float32([[0.9]]),
    "metallic": np.float32([[0.0]]),
}

# Σ over the fields: that of the light is learned for 1 cd of white, the static one as it is.
radiance = np.zeros((len(position), 3))
for field in fields:
    tint = light["intensity"] * np.float32(light["color"]) if field.role == "indirect" else 1.0
    radiance += reflectance * evaluate(field.graph, inputs)["radiance"] * tint

print(f"light '{light['name']}' at {light['initial']}, {light['intensity']} cd")
for point, value in zip(position, radiance):
    print("x, y, z = {:6.2f} {:6.2f} {:6.2f}    radiance = {:.4f} {:.4f} {:.4f}".format(*point, *value))
