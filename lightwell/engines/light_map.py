"""The light map of a bake as linear numbers: the diffuse light that its fields give at every texel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lightwell.asset.records import FieldEntry
from lightwell.graph import Buffer, Graph, evaluate

# Texels that are evaluated at a time.
BATCH = 1 << 16
# Reflectance for which the diffuse albedo is 1 and glTF's metallic 0: the field's result times it is irradiance / π
# (format/LIGHTMAP.md, "The field").
WHITE = 1.04
# The buffer whose red is 1 where the eye matters and whose green is 1 where the light map lights (format/LIGHTMAP.md).
MASK = "m"


def light_map(fields: Sequence[FieldEntry], variables: Sequence[Mapping[str, Any]]) -> np.ndarray | None:
    """Evaluate the diffuse light of all fields that read light-map coordinates.

    Args:
        fields: The fields of a bake.
        variables: JSON of its variables; each has its first value.

    Returns:
        [H, W, 3] float32 irradiance / π ≥ 0, row 0 at v = 0; None where no field reads light-map coordinates.
    """
    mapped = [entry for entry in fields if "uv1" in entry.graph.inputs]
    if not mapped:
        return None
    height, width = np.max([_size(entry.graph) for entry in mapped], axis=0)
    total = np.zeros((int(height) * int(width), 3), np.float32)
    for entry in mapped:
        given = variables[entry.variable] if entry.variable is not None else None
        gain = np.ones(3) if given is None else np.asarray(given["color"], float) * float(given["intensity"])
        light = None if given is None else np.asarray(given["initial"], np.float32)
        total += _diffuse(entry.graph, int(height), int(width), light) * gain.astype(np.float32)
    return np.maximum(total, 0).reshape(int(height), int(width), 3)


def _size(graph: Graph) -> tuple[int, int]:
    """Rows and columns of the largest picture that is read at the light-map coordinates."""
    sides = [(1, 1)]
    for node in graph.nodes:
        if node.op == "texture" and node.inputs == ("uv1",):
            height, width = graph.buffers[node.params["buffer"]].shape[:2]
            sides.append((height, width))
    return max(sides)


def _diffuse(graph: Graph, height: int, width: int, light: np.ndarray | None) -> np.ndarray:
    """[H W, 3] irradiance / π of a field on a white Lambertian surface."""
    matt = without_gloss(graph.only("radiance"))
    v, u = np.mgrid[0:height, 0:width].reshape(2, -1)
    uv = np.stack([(u + 0.5) / width, (v + 0.5) / height], axis=1).astype(np.float32)
    up = np.array([[0, 1, 0]], np.float32)
    constants = {
        "position": np.zeros((1, 3), np.float32),
        "normal": up,
        "view": up,
        "shading_normal": up,
        "light": np.zeros((1, 3), np.float32) if light is None else light[None],
        "reflectance": np.full((1, 3), WHITE, np.float32),
        "roughness": np.ones((1, 1), np.float32),
        "metallic": np.zeros((1, 1), np.float32),
        "uv": np.zeros((1, 2), np.float32),
        # Lamps shine as they were baked.
        "lamps": np.ones((1, matt.inputs.get("lamps", 1)), np.float32),
    }
    reads_reflectance = "reflectance" in matt.inputs
    rows = []
    for start in range(0, len(uv), BATCH):
        part = uv[start : start + BATCH]
        inputs = {name: np.repeat(constants[name], len(part), axis=0) for name in matt.inputs if name != "uv1"}
        rows.append(evaluate(matt, inputs | {"uv1": part})["radiance"])
    return np.concatenate(rows) * np.float32(WHITE if reads_reflectance else 1)


def without_gloss(graph: Graph) -> Graph:
    """Make the same field with a mask that calls every texel Lambertian and lit.

    Args:
        graph: A field that reads light-map coordinates.

    Returns:
        A field without view-dependent light; one without such a mask as it is.
    """
    mask = graph.buffers.get(MASK)
    if mask is None or mask.type != "uint8" or mask.shape[-1] != 3:
        return graph
    plain = np.zeros_like(mask.array)
    plain[..., 1] = 255
    buffer: Buffer = replace(mask, array=plain)
    return replace(graph, buffers={**graph.buffers, MASK: buffer})
