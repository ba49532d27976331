"""Tables of a scene for the transport kernels: areas, closed solids and one-sided materials; built once per scene.

Notation: M meshes, T triangles of all meshes together. The *front* of a triangle is the side to which its geometric
normal (counter-clockwise vertices) points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Mesh, Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.welding import equal_rows

# Vertices nearer than this share of a mesh's extent are one vertex when asking whether the mesh is closed.
WELD = 1e-5
# A closed mesh that contains this share of the area of all other meshes is the shell of a room.
SHELL_SHARE = 0.9
# A surface that lets more than this share through is looked through; without roughness it is clear glass.
CLEAR_TRANSMISSION = 0.5


@dataclass(frozen=True)
class SceneTables:
    """Properties per mesh and per triangle. Arrays are NumPy; kernels read them through ``dr.gather``."""

    area: np.ndarray
    """[T] float64, square metres."""
    mesh_of: np.ndarray
    """[T] uint32, the mesh of each triangle."""
    first: np.ndarray
    """[M + 1] first triangle of each mesh in the concatenation."""
    glossy: np.ndarray
    """[M] bool: the BSDF has a glossy or delta lobe, its radiance depends on the view."""
    front: np.ndarray
    """[M] bool: the front reflects or transmits."""
    back: np.ndarray
    """[M] bool: the back reflects or transmits."""
    air: np.ndarray
    """[M] int: of a closed mesh, the side that touches air: +1 front, -1 back; 0 for a mesh that is not closed."""
    volume: np.ndarray
    """[M] int: of a closed opaque body, +1 normals outwards, -1 inwards; 0 for all else and for shells of rooms."""
    transmissive: np.ndarray
    """[M] bool: light passes through (glass, masks)."""
    clear: np.ndarray
    """[M] bool: clear glass, which light passes in a straight line; none where all is looked through."""
    culled: np.ndarray
    """[M] bool: rasterisers draw the front alone, so that pictures show what lies behind the back."""
    looked_through: np.ndarray
    """[M] bool: glass, clear or frosted, which pictures show as if it were not there; none where all is such glass."""

    @property
    def mesh_area(self) -> np.ndarray:
        """[M] float64, square metres."""
        return np.add.reduceat(np.append(self.area, 0.0), self.first[:-1]) * (np.diff(self.first) > 0)


TABLES = Derived[SceneTables]("transport.tables")
SHAPE_LOOKUP = Derived[Any]("transport.shape_lookup")


def tables(scene: Scene) -> SceneTables:
    """Return the tables of a scene, built on first use and kept with it.

    Args:
        scene: Scene with one Mitsuba shape per mesh.

    Returns:
        The tables.
    """
    return scene.cache.get(TABLES, lambda: _build(scene))


def _build(scene: Scene) -> SceneTables:
    counts = [len(m.indices) for m in scene.meshes]
    shapes = scene.mi.shapes()
    if len(shapes) != len(counts):
        raise ValueError(
            f"transport: scene '{scene.name}' has {len(counts)} meshes but {len(shapes)} Mitsuba shapes; "
            "build it with lightwell.scenes (one shape per mesh, shape merging off)"
        )
    flags = [_bsdf_flags(s.bsdf()) for s in shapes]
    flag = mi.BSDFFlags
    one_way = np.array([not f & int(flag.Transmission) and not f & int(flag.Null) for f in flags])
    turn = np.array([_orientation(m) for m in scene.meshes])
    areas = [m.triangle_areas for m in scene.meshes]
    looked_through, clear = _glass(scene)
    shell = _shells(scene, turn, np.array([area.sum() for area in areas]))
    return SceneTables(
        area=np.concatenate(areas),
        mesh_of=np.repeat(np.arange(len(counts), dtype=np.uint32), counts),
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        glossy=np.array([bool(f & int(flag.Glossy | flag.Delta)) for f in flags]),
        front=np.array([bool(f & int(flag.FrontSide)) for f in flags]),
        back=np.array([bool(f & int(flag.BackSide)) for f in flags]),
        air=np.where(shell, -turn, turn),
        volume=np.where(shell | ~one_way, 0, turn),
        transmissive=~one_way,
        clear=clear,
        culled=np.array([not scene.materials[mesh.material].double_sided for mesh in scene.meshes], bool),
        looked_through=looked_through,
    )


def _glass(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Meshes that are looked through, and those among them that are clear, [M] bool each."""
    materials = [scene.materials[mesh.material] for mesh in scene.meshes]
    glass = np.array([m.transmission > CLEAR_TRANSMISSION for m in materials], bool)
    glass &= ~np.array([mesh.medium for mesh in scene.meshes], bool)
    glass &= not glass.all()
    return glass, glass & np.array([m.delta for m in materials], bool)


def _bsdf_flags(bsdf) -> int:
    return 0 if bsdf is None else int(bsdf.flags())


def _orientation(mesh: Mesh) -> int:
    """Return +1 (normals outwards) or -1 for a closed mesh, whose edges occur once in each direction; else 0."""
    extent = float(np.ptp(mesh.positions, axis=0).max())
    key = np.round(mesh.positions.astype(np.float64) / max(extent * WELD, 1e-30)).astype(np.int64)
    welded = equal_rows(key)[1]
    faces = welded[mesh.indices.astype(np.int64)]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    if len(faces) < 4:
        return 0
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    size = int(welded.max()) + 1
    forward, backward = np.sort(start * size + end), np.sort(end * size + start)
    if not np.array_equal(forward, backward):
        return 0
    a, b, c = (mesh.positions[mesh.indices[:, k]].astype(np.float64) - mesh.positions[0] for k in range(3))
    return int(np.sign(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()))


def _shells(scene: Scene, turn: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Find the closed meshes [M] that are shells of rooms: alone with inward normals, or around the other meshes."""
    boxes = np.array([(m.positions.min(axis=0), m.positions.max(axis=0)) for m in scene.meshes]).reshape(-1, 2, 3)
    if len(turn) == 1:
        return turn < 0
    shell = np.zeros(len(turn), bool)
    eyes = np.array([c.position for c in scene.cameras] + [l.position for l in scene.lights]).reshape(-1, 3)
    middle = (boxes[:, 0] + boxes[:, 1]) / 2
    for index in np.flatnonzero(turn):
        low, high = boxes[index]
        within = ((middle > low) & (middle < high)).all(axis=1)
        within[index] = False
        around = (area * within).sum() >= SHELL_SHARE * (area.sum() - area[index])
        shell[index] = around and (turn[index] < 0 or ((eyes > low) & (eyes < high)).all(axis=1).any())
    return shell


def shape_lookup(scene: Scene) -> mi.UInt32:
    """Return the mesh indices by Dr.Jit's instance number, for ``shape_index``.

    Args:
        scene: Scene with one Mitsuba shape per mesh.

    Returns:
        [instances] indices on the device.
    """
    return scene.cache.get(SHAPE_LOOKUP, lambda: _shape_lookup(scene))


def _shape_lookup(scene: Scene) -> mi.UInt32:
    ids = np.array(dr.reinterpret_array(mi.UInt32, scene.mi.shapes_dr()))
    lookup = np.zeros(int(ids.max()) + 1, np.uint32)
    lookup[ids] = np.arange(len(ids))
    return mi.UInt32(lookup)


def shape_index(lookup: mi.UInt32, shape: mi.ShapePtr) -> mi.UInt32:
    """Find the meshes that rays have hit.

    Args:
        lookup: Result of ``shape_lookup``.
        shape: Shapes that the rays hit.

    Returns:
        Indices into ``scene.meshes``; undefined for rays that hit nothing.
    """
    return dr.gather(mi.UInt32, lookup, dr.reinterpret_array(mi.UInt32, shape))
