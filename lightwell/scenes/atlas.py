"""The atlas of a light map: a separate region of one square texture for every lit side of every triangle.

Charts are cut and packed by xatlas; the author's second set of texture coordinates is used where it is valid.

Notation: T triangles of all meshes behind one another; side 0 is the front (the geometric normal's), 1 the back; uv in
[0, 1]², v downwards, texel (i, j) of an atlas of size n covers [j, j + 1] x [i, i + 1] / n.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from lightwell.scenes.atlas_charts import NOWHERE as NOWHERE
from lightwell.scenes.atlas_charts import components, cross, cut_charts, packed
from lightwell.scenes.atlas_coverage import texel_hits as texel_hits
from lightwell.scenes.scene import Mesh, Scene
from lightwell.scenes.triangle_groups import triangle_groups
from lightwell.scenes.welding import equal_rows

# A bilinear read at mip level m reaches this many texels of that level beyond its point: half a texel to the farther
# centre, one between the centres.
REACH = 1.5
# A normal that differs by its length counts as so many extents of distance.
TURN = 0.05


@dataclass(frozen=True)
class Atlas:
    """Texture coordinates and charts of every stored side."""

    size: int
    """Texels along each edge."""
    mips: int
    """Mip level up to which no texel mixes charts."""
    uv: np.ndarray
    """[2, T, 3, 2] float32: corners of every triangle, by side; of a side that is not stored, those of the other."""
    chart: np.ndarray
    """[2, T] int32: number of the chart, from 0; -1 where the side is not stored."""
    first: np.ndarray
    """[M + 1] first triangle of each mesh."""
    origin: str
    """How the coordinates were made, and why; shown in the report."""

    @property
    def charts(self) -> int:
        """Number of charts."""
        return int(self.chart.max()) + 1

    @property
    def coverage(self) -> float:
        """Share of the square that lies inside triangles, without padding."""
        a, b, c = (self.uv[self.chart >= 0][:, k].astype(np.float64) for k in range(3))
        return float(np.abs(cross(b - a, c - a)).sum() / 2)

    def lookup(self, shape: np.ndarray, triangle: np.ndarray, barycentric: np.ndarray, side: np.ndarray) -> np.ndarray:
        """Compute the texture coordinates of surface points.

        Args:
            shape: [N] indices of meshes.
            triangle: [N] indices of triangles in their mesh.
            barycentric: [N, 2] weights of the second and third vertex.
            side: [N] sides: 0 front, 1 back.

        Returns:
            [N, 2] float32 uv.
        """
        corners = self.uv[side, self.first[shape] + triangle]
        b = np.asarray(barycentric, np.float32)
        weights = np.stack([1 - b[:, 0] - b[:, 1], b[:, 0], b[:, 1]], axis=1)
        return np.einsum("nk,nkc->nc", weights, corners)


def padding(mips: int) -> int:
    """Compute the padding of a chart with which bilinear reads up to a mip level stay inside it.

    Half a texel is added for charts that end between texel centres.

    Args:
        mips: Largest mip level, ≥ 0.

    Returns:
        Texels on each side.
    """
    return int(np.ceil(REACH * 2**mips + 0.5))


def build(
    scene: Scene,
    size: int,
    lit: np.ndarray,
    mips: int = 1,
    density: np.ndarray | None = None,
    own: bool = True,
    dark: np.ndarray | None = None,
    faint: np.ndarray | None = None,
    deadline: float = np.inf,
) -> Atlas:
    """Make the atlas of a scene.

    Args:
        scene: Scene with T triangles in M meshes.
        size: Texels along each edge.
        lit: [2, T] bool: sides that are visible and lit; others are not stored.
        mips: Largest mip level at which charts must not mix.
        density: [M] texels per metre of each mesh relative to the others; None: the same for all.
        own: Use the author's second texture coordinates where they are valid.
        dark: [2, T] bool: sides that are visible and unlit, or must not read the light map (clear glass); they refer to
            the corner that no chart uses. All other sides that are not stored refer to the texels of the other side.
        faint: [2, T] bool: large sides that are hardly visible; they get fewer texels.
        deadline: ``perf_counter()`` at which the search for a better packing ends.

    Returns:
        The atlas.

    Raises:
        ValueError: No side is visible and lit.
    """
    first = np.cumsum([0] + [len(mesh.indices) for mesh in scene.meshes])
    if not lit.any():
        raise ValueError(f"atlas: no side of scene '{scene.name}' is seen and lit; is a light on?")
    reason = "no second texture coordinates"
    if own and all(mesh.uv1 is not None for mesh in scene.meshes):
        reason = own_fault(scene, size, lit, mips)
        if not reason:
            return _authored(scene, size, lit, mips, first)
    groups = triangle_groups(scene)
    if groups.count:
        reason += f"; {np.count_nonzero(~groups.alone)} small triangles share charts in {groups.count} groups"
    cut = cut_charts(scene, lit, density, np.zeros_like(lit) if faint is None else faint)
    uv, chart = packed(cut, size, padding(mips), lit, deadline)
    _borrow(scene, uv, chart, dark)
    return Atlas(size, mips, _both(uv, chart, dark), chart, first, f"xatlas ({reason})")


def _borrow(scene: Scene, uv: np.ndarray, chart: np.ndarray, dark: np.ndarray | None) -> None:
    """Let triangles of which no side is stored read the nearest stored triangle of about their direction.

    A search for visible sides can miss some, and black is the worst guess.
    """
    groups = triangle_groups(scene)
    missing: np.ndarray = np.all(chart < 0, axis=0)
    if dark is not None:
        missing &= ~dark.any(axis=0)
    side, triangle = np.nonzero((chart >= 0) & groups.tested)
    asked, reader = groups.readers(missing)
    if not len(asked) or not len(side):
        return
    rows, of = np.unique(np.concatenate([triangle, asked]), return_inverse=True)
    corners = np.concatenate([m.positions[m.indices.astype(np.int64)] for m in scene.meshes])[rows].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    place = np.concatenate([corners.mean(axis=1), TURN * scene.core_extent * normal], axis=1)
    nearest = cKDTree(place[of[: len(triangle)]]).query(place[of[len(triangle) :]])[1]
    uv[:, missing] = uv[side[nearest], triangle[nearest]].mean(axis=1)[reader][None, :, None]


def _both(uv: np.ndarray, chart: np.ndarray, dark: np.ndarray | None) -> np.ndarray:
    """Copy the coordinates of stored sides to sides that are not stored, unless these are visible and dark."""
    for side in (0, 1):
        borrowed = (chart[side] < 0) & (chart[1 - side] >= 0)
        borrowed &= True if dark is None else ~dark[side]
        uv[side, borrowed] = uv[1 - side, borrowed]
    return uv


# ---------------------------------------------------------------------- the author's coordinates

# Share of covered texels that may be hit twice.
OVERLAP = 0.005


def _own_corners(scene: Scene) -> np.ndarray:
    corners = [mesh.uv1[mesh.indices.astype(np.int64)] for mesh in scene.meshes if mesh.uv1 is not None]
    return np.concatenate(corners).astype(np.float32)


def own_fault(scene: Scene, size: int, lit: np.ndarray, mips: int) -> str:
    """Find the reason why the author's second texture coordinates cannot be used.

    Args:
        scene: Scene whose meshes all have a second set.
        size: Texels along each edge.
        lit: [2, T] bool: sides to store.
        mips: Largest mip level at which charts must not mix.

    Returns:
        The reason; empty when they can be used.
    """
    uv = _own_corners(scene)
    stored = lit.any(axis=0)
    if not np.isfinite(uv).all():
        return "the author's second texture coordinates contain NaN or infinity"
    if uv[stored].min() < 0 or uv[stored].max() > 1:
        return "the author's second texture coordinates leave [0, 1]"
    if (lit[0] & lit[1]).any():
        return "sheets are lit from both sides, which the author's coordinates do not tell apart"
    area = np.abs(cross(uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]))
    if (area[stored] <= 0).any():
        return f"{int((area[stored] <= 0).sum())} triangles have no area in the author's second texture coordinates"
    hits, owner = texel_hits(uv[stored], _author_charts(scene)[stored], size)
    covered = max(int((hits > 0).sum()), 1)
    if (shared := int((hits > 1).sum())) > OVERLAP * covered:
        return f"{shared / covered:.1%} of the author's texels are used twice"
    gap = _gap(owner)
    if gap < 2:
        return f"charts of the author's second texture coordinates come within {gap:.0f} texel(s) at {size} x {size}"
    return ""


def _author_charts(scene: Scene) -> np.ndarray:
    """Number the connected parts of the author's coordinates [T]: corners that share both position and uv."""
    labels, count = [], 0
    for mesh in scene.meshes:
        inverse = equal_rows(np.concatenate([mesh.positions, mesh.uv1], axis=1))[1]
        corners = inverse[mesh.indices.astype(np.int64)]
        labels.append(components(corners, int(inverse.max()) + 1) + count)
        count = int(labels[-1].max()) + 1
    return np.concatenate(labels)


def _gap(owner: np.ndarray) -> float:
    """Measure the smallest distance between texels of different charts, minus one texel."""
    from scipy.ndimage import distance_transform_edt

    covered = owner >= 0
    distance, index = distance_transform_edt(~covered, return_indices=True)
    near = owner[tuple(index)]
    smallest = np.inf
    for here, there in ((np.s_[1:, :], np.s_[:-1, :]), (np.s_[:, 1:], np.s_[:, :-1])):
        differs = near[here] != near[there]
        if differs.any():
            smallest = min(smallest, float((distance[here] + distance[there])[differs].min()))
    return smallest


def _authored(scene: Scene, size: int, lit: np.ndarray, mips: int, first: np.ndarray) -> Atlas:
    uv, label = _own_corners(scene), _author_charts(scene)
    numbers = np.unique(label, return_inverse=True)[1].reshape(-1)
    chart = np.where(lit, numbers[None], -1).astype(np.int32)
    # The author's charts may use the corner texel, so dark sides refer to the other side here.
    both = _both(np.stack([uv, uv]), chart, None)
    own_gap = _gap(texel_hits(uv[lit.any(axis=0)], numbers[lit.any(axis=0)], size)[1])
    safe = max((m for m in range(mips + 1) if 2 * padding(m) <= own_gap), default=0)
    return Atlas(size, safe, both, chart, first, "the author's second texture coordinates")


# ---------------------------------------------------------------------- output meshes


def charted(scene: Scene, atlas: Atlas) -> Scene:
    """Make a scene whose meshes have ``uv1`` from an atlas, vertices split along chart borders.

    A sheet whose two sides have different coordinates becomes two meshes of opposite winding. Both are culled from
    behind: in the same place, each would otherwise cover the other. A solid with a medium becomes opaque: its light map
    holds what comes through it.

    Args:
        scene: Scene that was unwrapped.
        atlas: Its atlas.

    Returns:
        The scene: its materials are those of ``scene`` and behind them the changed ones.
    """
    meshes: list[Mesh] = []
    materials = list(scene.materials)
    culled: dict[int, int] = {}
    for number, mesh in enumerate(scene.meshes):
        if mesh.medium:
            materials.append(replace(materials[mesh.material], transmission=0.0, thickness=0.0))
            mesh = replace(mesh, material=len(materials) - 1)
        rows = slice(atlas.first[number], atlas.first[number + 1])
        twice = (atlas.chart[0, rows] >= 0) & (atlas.uv[0, rows] != atlas.uv[1, rows]).any(axis=(1, 2))
        front, material = _main_uv(atlas, rows), materials[mesh.material]
        if not twice.any():
            meshes.append(_charted(mesh, mesh.indices, front, mesh.name))
            continue
        sheet, once = mesh, ~twice
        if material.double_sided:
            if mesh.material not in culled:
                culled[mesh.material] = len(materials)
                materials.append(replace(material, double_sided=False))
            sheet = replace(mesh, material=culled[mesh.material])
            if once.any():
                meshes.append(_charted(mesh, mesh.indices[once], front[once], f"{mesh.name} (one chart)"))
        kept = twice if material.double_sided else twice | once
        meshes.append(_charted(sheet, mesh.indices[kept], front[kept], mesh.name))
        turned = mesh.indices[twice][:, ::-1]
        if material.dark_back:
            dark = replace(material, emissive=(0.0, 0.0, 0.0), emissive_texture=None, double_sided=False)
            materials.append(replace(dark, name=f"{material.name}, back"))
            sheet = replace(sheet, material=len(materials) - 1, emission=(0.0, 0.0, 0.0))
        back = _charted(sheet, turned, atlas.uv[1, rows][twice][:, ::-1], f"{mesh.name} (back)")
        meshes.append(replace(back, normals=None if back.normals is None else -back.normals))
    return replace(scene, meshes=meshes, materials=materials)


def _main_uv(atlas: Atlas, rows: slice) -> np.ndarray:
    front, back = atlas.uv[:, rows]
    return np.where((atlas.chart[0, rows] >= 0)[:, None, None], front, back)


def _charted(mesh: Mesh, indices: np.ndarray, uv: np.ndarray, name: str) -> Mesh:
    """Make a mesh with one vertex for every distinct (vertex, uv)."""
    corner = indices.astype(np.int64).reshape(-1)
    key = np.concatenate([corner[:, None].astype(np.float64), uv.reshape(-1, 2)], axis=1)
    vertex, inverse = equal_rows(key)
    found = key[vertex]
    source = found[:, 0].astype(np.int64)

    def take(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else values[source]

    return replace(
        mesh,
        name=name,
        positions=mesh.positions[source],
        indices=inverse.reshape(-1, 3).astype(np.uint32),
        normals=take(mesh.normals),
        uv0=take(mesh.uv0),
        uv1=found[:, 1:].astype(np.float32),
        colors=take(mesh.colors),
    )
