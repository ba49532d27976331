"""A tiny asset with a neural light map, for tests of runtimes: python tools/lightmap_example.py OUT.glb [--ktx2]

Two squares (floor and wall), a 16 x 16 PNG and an 8 x 8 lossless WebP, a network of two layers with fixed random
weights, the fallback MOZ_lightmap. OUT.json beside it holds inputs of the graph and what NumPy makes of them. With
--ktx2 both pictures are KTX2, and OUT.json holds what they decode to. With --lamps the light is that of three lamps
with a switch each, in two pictures that are even on the wall; OUT.json holds what each takes of them.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from lightwell.asset.records import Fallback, FieldEntry, LampEntry
from lightwell.asset.write import write_glb
from lightwell.fields.lightmap.fit import LightmapPreset
from lightwell.fields.lightmap.lamp_map import LampMap
from lightwell.fields.lightmap.nodes import MapNodes
from lightwell.graph import Builder, Graph, evaluate, quantise
from lightwell.graph.pictures import Picture, encode
from lightwell.networks.lightmap import LightmapNetwork
from lightwell.networks.lightmap_lamps import LampLightmapNetwork
from lightwell.scenes.assemble import assemble
from lightwell.scenes.scene import Camera, Material, Mesh


def scene():
    """A floor and a wall, each on its half of the atlas, with a border of two texels."""
    square = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], np.float32)
    wall = np.array([[-1, 0, -1], [1, 0, -1], [1, 2, -1], [-1, 2, -1]], np.float32)
    indices = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    uv = np.array([[0.125, 0.875], [0.375, 0.875], [0.375, 0.125], [0.125, 0.125]], np.float32)
    meshes = [
        Mesh("floor", square, indices, 0, np.tile(np.float32([0, 1, 0]), (4, 1)), uv0=uv, uv1=uv),
        Mesh("wall", wall, indices, 1, np.tile(np.float32([0, 0, 1]), (4, 1)), uv0=uv, uv1=uv + np.float32([0.5, 0])),
    ]
    materials = [
        Material("floor", (0.5, 0.4, 0.3, 1), metallic=0.0, roughness=0.3),
        Material("wall", (0.7, 0.7, 0.8, 1), metallic=0.0, roughness=0.9),
    ]
    return assemble("light map example", meshes, materials, cameras=[Camera((0.4, 1.1, 2.6), (0, 0.7, -0.4))])


def ramp() -> np.ndarray:
    """[16, 16, 3] uint8: red grows to the right, green downwards."""
    v, u = np.mgrid[0:16, 0:16] / 15
    return np.rint(255 * np.stack([0.3 + 0.5 * u, 0.3 + 0.5 * v, 0.6 - 0.2 * u * v], axis=-1)).astype(np.uint8)


def pictures(ktx2: bool = False) -> dict[str, Picture]:
    """The ramp, and features of all values; as KTX2 the ramp has a mip level."""
    features = np.random.default_rng(1).integers(0, 256, (8, 8, 3)).astype(np.uint8)
    if ktx2:
        return {"e": encode(ramp(), "uastc", 1), "f0": encode(features, "uastc")}
    return {"e": encode(ramp(), "png"), "f0": encode(features, "webp")}


def graph(stored: dict[str, Picture]) -> Graph:
    """Diffuse light from the ramp, and a little light of a network that sees the eye."""
    rng = np.random.default_rng(2)
    b = Builder(uv1=2, normal=3, view=3, roughness=1)
    q = b.affine(b.texture("uv1", b.buffer(stored["e"].buffer(), "e")), [0.9] * 3, [0.02] * 3)
    u = b.multiply(q, q)
    diffuse = b.multiply(u, b.reciprocal(b.affine(u, [-1] * 3, [1] * 3), 1 / 64))
    f = b.affine(b.texture("uv1", b.buffer(stored["f0"].buffer(), "f0")), [2, 3, 4], [-1, -1, -2])
    x = b.concat(f, b.reflect("normal", "view"), b.dot("normal", "view"), "roughness")
    h = b.activate(b.linear(x, rng.normal(0, 0.4, (8, 8)), rng.normal(0, 0.1, 8)), "relu")
    gloss = b.activate(b.linear(h, rng.normal(0, 0.4, (3, 8)), np.full(3, -3.0)), "exp")
    return quantise_network(b.build(radiance=b.add(diffuse, gloss)))


def lamp_graph() -> tuple[Graph, dict[str, Picture], LampMap]:
    """The light of three lamps in two pictures; the floor is glossy, the wall is not."""
    texels = [ramp(), ramp()[::-1, ::-1].copy()]
    for image, byte in zip(texels, (150, 90)):
        image[:, 8:] = byte
    mask = np.zeros((16, 16, 3), np.uint8)
    mask[:, :8, 0], mask[..., 1] = 255, 255
    taken = np.array([[[1.0, 0.9, 0.8], [0, 0, 0]], [[0, 0, 0], [0.5, 1.0, 1.5]], [[0.25] * 3, [0.5, 0.25, 0.125]]])
    lamps = LampMap(
        ("warm", "cool", "both"), tuple(encode(t, "png") for t in texels), taken.astype(np.float32), np.ones(3)
    )
    preset = LightmapPreset("png", channels=3, share=0.5, hidden=(8,), inputs="mirror")
    network = LampLightmapNetwork.of(LightmapNetwork(None, 3, 6, preset.hidden), 3, 2, lamps.features)
    nodes = MapNodes(preset, 2.0, encode(ramp(), "png"), None, mask=encode(mask, "png"), lamps=lamps)
    features = {"f0": pictures()["f0"]}
    stored = {**lamps.stored, "m": nodes.mask, **features}
    return nodes.lowered(features, network.initial(4)), stored, lamps


def quantise_network(made: Graph) -> Graph:
    """Weights as half floats; the pictures stay as they are."""
    from dataclasses import replace

    half = quantise(made)
    return replace(made, buffers={k: v if v.type == "uint8" else half.buffers[k] for k, v in made.buffers.items()})


def main(out: Path, ktx2: bool = False, lamps: bool = False) -> None:
    """Write OUT.glb and OUT.json."""
    stored, entries, told = pictures(ktx2), [], {}
    made = graph(stored)
    if lamps:
        made, stored, map_of_lamps = lamp_graph()
        entries = [LampEntry(name) for name in map_of_lamps.names]
        told = {"taken": map_of_lamps.weights.tolist(), "bytes": [150, 90], "unit": 2.0}
    entry = FieldEntry("lightmap", "static", made, pictures=stored)
    write_glb(out, scene(), [entry], [], fallback=Fallback(encode(ramp(), "jpeg90"), 2.0), lamps=entries)
    rng = np.random.default_rng(3)
    inputs = {name: rng.normal(size=(32, width)) for name, width in made.inputs.items()}
    inputs = {
        k: (v / np.linalg.norm(v, axis=1, keepdims=True) if v.shape[1] == 3 else rng.random(v.shape))
        for k, v in inputs.items()
    }
    if lamps:  # The same at all places.
        inputs["lamps"] = np.tile(inputs["lamps"][:1], (32, 1))
    inputs = {k: v.astype(np.float32) for k, v in inputs.items()}
    outputs = evaluate(made, inputs)
    rows = {k: np.asarray(v, float).round(7).tolist() for k, v in inputs.items()}
    text = {"inputs": rows, "outputs": {k: np.asarray(v, float).tolist() for k, v in outputs.items()}} | told
    if ktx2:
        levels = {name: [p.buffer(m).array.tolist() for m in range(p.mips + 1)] for name, p in stored.items()}
        text = {"texels": levels}
    out.with_suffix(".json").write_text(json.dumps(text))
    print(f"{out}: {out.stat().st_size} bytes")


if __name__ == "__main__":
    options = ("--ktx2", "--lamps")
    names = [argument for argument in sys.argv[1:] if argument not in options]
    main(Path(names[0] if names else "lightmap-example.glb"), *(option in sys.argv for option in options))
