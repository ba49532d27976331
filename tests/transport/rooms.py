"""Small scenes of the transport tests, made from records. Metres; +Y up."""

from __future__ import annotations

import numpy as np

from lightwell.backend import mi
from lightwell.scenes.assemble import assemble
from lightwell.scenes.scene import Camera, Material, Mesh, Scene

WHITE, RED, GREEN = (0.73, 0.71, 0.68), (0.63, 0.065, 0.05), (0.14, 0.45, 0.091)


def diffuse(color) -> dict:
    """A two-sided diffuse BSDF."""
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(color)}}}


def quad(name: str, corner, u, v, material: int = 0) -> Mesh:
    """A parallelogram whose front is the side that u x v points to."""
    corner, u, v = (np.asarray(a, np.float32) for a in (corner, u, v))
    positions = np.stack([corner, corner + u, corner + u + v, corner + v])
    return Mesh(name, positions, np.uint32([[0, 1, 2], [0, 2, 3]]), material)


def box(name: str, low, high, material: int = 0, inward: bool = False, turn: float = 0.0) -> Mesh:
    """A closed box, optionally turned by ``turn`` radians about the vertical through its middle."""
    low, high = np.asarray(low, np.float32), np.asarray(high, np.float32)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.uint32([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    if inward:
        faces = faces[:, ::-1]
    middle = (low + high) / 2
    offset = low + corners * (high - low) - middle
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]], np.float32)
    return Mesh(name, (offset @ rotation.T + middle).astype(np.float32), faces, material)


def build(name: str, meshes, bsdfs, area_lights=None, cameras=(), emitters=()) -> Scene:
    """A scene with one BSDF dictionary per mesh; the records all name one plain material."""
    made = [mi.load_dict(b) for b in bsdfs]
    lights = None if area_lights is None else [None if a is None else mi.load_dict(a) for a in area_lights]
    material = Material("plain", metallic=0.0)
    return assemble(
        name, meshes, [material], cameras=cameras, bsdfs=made, area_lights=lights, emitters=emitters, digest=name
    )


def room_walls() -> list[Mesh]:
    """Five walls of a 2 m room, open to +Z, fronts inside: floor, ceiling, back, left, right."""
    return [
        quad("floor", (-1, 0, -1), (0, 0, 2), (2, 0, 0)),
        quad("ceiling", (-1, 2, -1), (2, 0, 0), (0, 0, 2)),
        quad("back", (-1, 0, -1), (2, 0, 0), (0, 2, 0)),
        quad("left", (-1, 0, -1), (0, 2, 0), (0, 0, 2)),
        quad("right", (1, 0, -1), (0, 0, 2), (0, 2, 0)),
    ]


def cornell(tall: dict | None = None, short: dict | None = None, floor: dict | None = None) -> Scene:
    """A Cornell-like room with two boxes standing on the floor; BSDFs of boxes and floor may be replaced."""
    white = diffuse(WHITE)
    meshes = [
        *room_walls(),
        box("tall", (-0.65, 0, -0.65), (-0.05, 1.2, -0.05), turn=0.3),
        box("short", (0.1, 0, 0.0), (0.7, 0.6, 0.6), turn=-0.3),
    ]
    bsdfs = [floor or white, white, white, diffuse(RED), diffuse(GREEN), tall or white, short or white]
    camera = Camera((0, 1, 4.4), (0, 1, 0), fov_y=36.0, name="front")
    return build("cornell", meshes, bsdfs, cameras=[camera])


def furnace(albedo: float, emission: float = 1.0) -> Scene:
    """A closed box whose walls all reflect ``albedo`` and emit ``emission``; the radiance is E / (1 - ρ) everywhere."""
    shell = box("shell", (-1, -1, -1), (1, 1, 1), inward=True)
    bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [albedo] * 3}}
    light = {"type": "area", "radiance": {"type": "rgb", "value": [emission] * 3}}
    return build("furnace", [shell], [bsdf], [light])


def plane(albedo: float = 0.5) -> Scene:
    """A diffuse 2 m floor with its front up."""
    return build("plane", [quad("floor", (-1, 0, -1), (0, 0, 2), (2, 0, 0))], [diffuse([albedo] * 3)])
