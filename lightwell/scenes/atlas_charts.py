"""Charts of an atlas: the triangles they are cut from, and the largest scale at which they fit the square.

Notation: see ``atlas``; K triangles of a piece; charts are laid out in the plane as points [V, 2] and corners [K, 3].
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from lightwell.scenes.atlas_coverage import coverings as coverings
from lightwell.scenes.atlas_panels import Panel, collect, laid_out, panels
from lightwell.scenes.atlas_shelves import shelved
from lightwell.scenes.packer import Packer, Packing
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.triangle_groups import triangle_groups
from lightwell.scenes.welding import components as components
from lightwell.scenes.welding import equal_rows

# Points [N, 2], triangles [T, 3] and number of charts of a piece.
Laid = tuple[np.ndarray, np.ndarray, int]
# More charts than this on 1024 x 1024 are packed by xatlas' fast method: brute force takes seconds per thousand there,
# and minutes on larger squares.
BRUTE_CHARTS = 700
# Rounds that fit the packing into its square, and the step back when it is too large.
FIT_ROUNDS, SHRINK = 6, 0.985
# The least factor from one scale to the next.
LEAST_STEP = 0.25
# No scale near the one that is sought fits where the charts take more than so many times the edge of the square.
HOPELESS = 1.1
# Coverage of the square by charts that the search aims at, by how much each further round lowers it, and the number of
# rounds.
GOAL, GOAL_STEP, GOAL_ROUNDS = 0.71, 0.002, 12
# Edge of the square, in texels, that charts are cut for: xatlas lays them out in texels.
CUT_EDGE = 900.0
# Share of the covered texels that may be covered twice.
TWICE = 5e-4
# Charts that would cover less than this share of the square do not fit: xatlas drops charts that become too small.
LEAST_COVERAGE = 0.03
# Charts of fewer texels share one small triangle with those of the same mesh, side, direction and cell: its edge in
# texels, and the cells along each axis of the mesh.
TINY, SHARED_EDGE, SHARED_CELLS = 4.0, 2.0, 4
# Texels per metre of hardly visible sides, relative to the others.
FAINT = 0.25
# Hidden triangles refer to the texel in this corner, which no chart uses.
NOWHERE = 0.0


@dataclass(frozen=True)
class Piece:
    """Triangles of one mesh and side, with vertices welded by position."""

    positions: np.ndarray
    indices: np.ndarray
    triangle: np.ndarray
    """[K] number in the concatenation."""
    side: int
    shared: np.ndarray | None = None
    """Numbers of triangles that all read the middle of the only triangle of this piece."""


def pieces(scene: Scene, lit: np.ndarray, density: np.ndarray | None, faint: np.ndarray) -> list[Piece]:
    """Divide the triangles of a scene, but for those in groups, into pieces for cutting.

    Per mesh: the triangles that are lit from any side, then those lit from both sides once more, with opposite winding;
    triangles that are hardly visible on that side are pieces of their own.

    Args:
        scene: Scene with T triangles in M meshes.
        lit: [2, T] bool: sides to store.
        density: [M] texels per metre of each mesh relative to the others; None: the same for all.
        faint: [2, T] bool: sides that get fewer texels.

    Returns:
        The pieces.
    """
    pieces, start = [], 0
    lit = lit & triangle_groups(scene).alone
    # The first piece of a triangle that is lit from its back only is the back.
    shown = (np.where(lit[0], faint[0], faint[1]), faint[1])
    for number, mesh in enumerate(scene.meshes):
        here = np.arange(start, start + len(mesh.indices))
        start += len(mesh.indices)
        if not lit[:, here].any():
            continue
        scale = 1.0 if density is None else float(density[number])
        vertex, inverse = equal_rows(mesh.positions)
        welded, corners = mesh.positions[vertex], inverse[mesh.indices.astype(np.int64)]
        for side, wanted in ((0, lit[:, here].any(axis=0)), (1, lit[:, here].all(axis=0))):
            for few in (False, True):
                chosen = wanted & (shown[side][here] == few)
                if not chosen.any():
                    continue
                turned = corners[chosen] if side == 0 else corners[chosen][:, ::-1]
                used, compact = np.unique(turned, return_inverse=True)
                positions = np.ascontiguousarray(welded[used] * np.float32(scale * (FAINT if few else 1.0)))
                pieces.append(Piece(positions, compact.reshape(-1, 3).astype(np.uint32), here[chosen], side))
    return pieces


@dataclass(frozen=True)
class Cut:
    """Charts that are cut and not yet packed."""

    pieces: list[Piece]
    flat: list[tuple[np.ndarray, np.ndarray]]
    """Points [V, 2] in texels and corners [K, 3] of every piece."""
    charts: int
    panels: list[Panel]
    """Charts of groups of small triangles."""
    texels: float
    """Texels per metre of the points, for meshes of mean density."""

    @property
    def total(self) -> float:
        """Area of all charts, texels."""
        area = sum(_area(points, corners) for points, corners in self.flat)
        return area + self.texels**2 * sum(float(panel.edges.prod()) for panel in self.panels)


CUT = Derived[Cut]("scenes.atlas_cut")


def cut_charts(scene: Scene, lit: np.ndarray, density: np.ndarray | None, faint: np.ndarray) -> Cut:
    """Cut the stored sides of a scene into charts; the last result is kept with the scene, for atlases of other sizes.

    Args:
        scene: Scene with T triangles in M meshes.
        lit: [2, T] bool: sides to store.
        density: [M] texels per metre of each mesh relative to the others; None: the same for all.
        faint: [2, T] bool: sides that get fewer texels.

    Returns:
        The charts.
    """

    def made() -> Cut:
        cut, rest = pieces(scene, lit, density, faint), panels(scene, lit, density, triangle_groups(scene))
        surface = sum(_surface(piece) for piece in cut) + sum(float(panel.edges.prod()) for panel in rest)
        texels = CUT_EDGE / np.sqrt(max(surface, 1e-30))
        with Packer() as packer:
            flat, charts = packer.cut([(piece.positions, piece.indices) for piece in cut], texels)
        flat = [_finite(piece, points, corners, texels) for piece, (points, corners) in zip(cut, flat)]
        return Cut(cut, flat, charts + len(rest), rest, float(texels))

    arrays = (lit, faint) if density is None else (lit, faint, density)
    return scene.cache.get(CUT, made, hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest())


def packed(cut: Cut, size: int, pad: int, lit: np.ndarray, deadline: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    """Pack charts into one square.

    Args:
        cut: Charts.
        size: Texels along each edge.
        pad: Texels of padding around each chart.
        lit: [2, T] bool: sides to store.
        deadline: ``perf_counter()`` at which the search for a better packing ends.

    Returns:
        uv [2, T, 3, 2] and charts [2, T].

    Raises:
        ValueError: The charts do not fit into the square.
    """
    scale = np.sqrt(0.6 * size * size / max(cut.total, 1e-30))
    made, laid = _merged(cut.pieces, cut.flat, scale)
    laid += [laid_out(panel, cut.texels, scale) for panel in cut.panels]
    best = None
    if not cut.panels:
        with Packer() as packer:
            best = fitted(laid, size, pad, scale, packer.pack, deadline=deadline)
    if best is None and (cut.panels or perf_counter() > deadline):
        best = shelved(laid, size, pad)
    if best is None or cut.total * best[0] ** 2 < LEAST_COVERAGE * size * size:
        raise ValueError(
            f"atlas: {cut.charts} charts with {pad} texels of padding do not fit into {size} x {size} texels; "
            "give a larger --size or fewer --mips"
        )
    return _collected(best[1], made, size, pad + 1, lit, cut.panels)


def _surface(piece: Piece) -> float:
    """Compute the area of a piece, m²."""
    a, b, c = (piece.positions[piece.indices[:, k]].astype(np.float64) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _finite(piece: Piece, points: np.ndarray, corners: np.ndarray, texels: float) -> tuple[np.ndarray, np.ndarray]:
    """Lay triangles without finite texels flat one by one: xatlas flattens triangles of no area to NaN."""
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1)[corners].all(axis=1))
    if not len(bad):
        return points, corners
    a, b, c = (piece.positions[piece.indices[bad, k]].astype(np.float64) * texels for k in range(3))
    first, last = np.linalg.norm(b - a, axis=1), np.linalg.norm(c - a, axis=1)
    along = ((b - a) * (c - a)).sum(axis=1) / np.maximum(first, 1e-30)
    laid = np.zeros((len(bad), 3, 2))
    laid[:, 1, 0], laid[:, 2, 0] = first, along
    laid[:, 2, 1] = np.sqrt(np.maximum(last**2 - along**2, 0.0))
    corners = corners.copy()
    corners[bad] = len(points) + np.arange(3 * len(bad), dtype=corners.dtype).reshape(-1, 3)
    return np.concatenate([np.nan_to_num(points, nan=0.0), laid.reshape(-1, 2).astype(points.dtype)]), corners


def _apart(packing: Packing) -> bool:
    """Test whether no two charts of a packing overlap."""
    corners = [points[rows] for points, rows in packing.meshes]
    hits = coverings(np.concatenate(corners), packing.width + 1, packing.height + 1)
    return int((hits > 1).sum()) <= TWICE * int((hits > 0).sum())


def fitted(
    laid: Sequence[Laid],
    size: int,
    pad: int,
    scale: float,
    pack: Callable[..., Packing],
    apart: Callable[[Packing], bool] = _apart,
    rounds: int = GOAL_ROUNDS,
    deadline: float = np.inf,
) -> tuple[float, Packing] | None:
    """Search the largest scale at which charts fit a square.

    The space that the packer leaves free at the borders changes by a tenth from one scale to the next, and at some
    scales it places charts on top of others.

    Args:
        laid: Points [N, 2], triangles [T, 3] and number of charts of every piece.
        size: Texels along each edge.
        pad: Texels of padding around each chart.
        scale: Scale that is tried first, texels per unit.
        pack: As ``Packer.pack``.
        apart: Function that tells whether no two charts of a packing overlap.
        rounds: Scales that are tried in the end because they would fill the square, at most.
        deadline: ``perf_counter()`` at which the search ends with what it has.

    Returns:
        Scale and packing; None where none fits.
    """
    brute, best = sum(f[2] for f in laid) * (size / 1024) ** 3 <= BRUTE_CHARTS, None
    area, last = sum(_area(points, corners) for points, corners, _ in laid), (0.0, np.inf)
    for attempt in range(2 * FIT_ROUNDS):
        if (best is not None and attempt >= FIT_ROUNDS) or perf_counter() > deadline:
            break
        packing, extent = _scaled(laid, scale, pad, brute, pack)
        if extent <= size and (best is None or scale > best[0]) and apart(packing):
            best = (scale, packing)
        if SHRINK * size < extent <= size:
            break
        step = _step(size, pad, (scale, extent), last)
        if best is not None and scale * step * SHRINK <= best[0]:
            break
        last = (scale, extent)
        scale *= step * (SHRINK if extent > size else 1.0)
    coverage = 0.0 if best is None else area * best[0] ** 2 / size**2
    for wanted in GOAL - GOAL_STEP * np.arange(rounds):
        if wanted <= coverage or perf_counter() > deadline:
            break
        scale = np.sqrt(wanted * size * size / area)
        packing, extent = _scaled(laid, scale, pad, brute, pack)
        if extent <= size and apart(packing):
            return scale, packing
        if extent > HOPELESS * size:
            break
    return best


def _step(size: int, pad: int, now: tuple[float, float], last: tuple[float, float]) -> float:
    """Factor to the next scale, from the last two scales and the edges of the square that they took."""
    (scale, extent), (before, edge) = now, last
    if not np.isfinite(extent):
        return 0.7
    step = (size - 3 * pad) / max(extent - 3 * pad, 1)
    slope = (extent - edge) / (scale - before) if np.isfinite(edge) and scale != before else 0.0
    if slope <= 0:
        return step
    # Padding does not shrink with the charts: where they are many, the edge is far from proportional to the scale.
    straight = max(1 + (size - extent) / (slope * scale), LEAST_STEP)
    return min(straight, step if extent > size else 1 / LEAST_STEP)


def _area(points: np.ndarray, corners: np.ndarray) -> float:
    a, b, c = (points[corners[:, k]].astype(np.float64) for k in range(3))
    return float(np.abs(cross(b - a, c - a)).sum() / 2)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute the cross product of plane vectors.

    Args:
        a: [..., 2] vectors.
        b: [..., 2] vectors.

    Returns:
        [...] products.
    """
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _merged(
    pieces: Sequence[Piece], flat: Sequence[tuple[np.ndarray, np.ndarray]], scale: float
) -> tuple[list[Piece], list[Laid]]:
    """Let tiny charts share one small triangle for each direction and cell; returns pieces and what is laid out."""
    made, laid = [], []
    for piece, (points, corners) in zip(pieces, flat):
        chart = components(corners.astype(np.int64), len(points))
        a, b, c = (points[corners[:, k]].astype(np.float64) for k in range(3))
        area = np.abs(cross(b - a, c - a)) / 2 * scale * scale
        tiny = np.bincount(chart, weights=area)[chart] < TINY
        if (~tiny).any():
            made.append(replace(piece, indices=piece.indices[~tiny], triangle=piece.triangle[~tiny]))
            laid.append((points, np.ascontiguousarray(corners[~tiny]), len(np.unique(chart[~tiny]))))
        key = np.where(tiny, _direction(piece), -1)
        for direction in np.unique(key[tiny]):
            rows = np.flatnonzero(key == direction)
            largest = rows[np.argmax(area[rows])]
            made.append(
                replace(piece, indices=piece.indices[[largest]], triangle=piece.triangle[[largest]],
                        shared=piece.triangle[rows])
            )  # fmt: skip
            edge = SHARED_EDGE / scale
            corner = np.array([[0, 0], [edge, 0], [0, edge]], np.float32)
            laid.append((corner, np.arange(3, dtype=np.uint32)[None], 1))
    return made, laid


def _direction(piece: Piece) -> np.ndarray:
    """Number [K] the cell that each triangle lies in and the axis direction that is nearest to its normal."""
    a, b, c = (piece.positions[piece.indices[:, k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    axis = np.abs(normal).argmax(axis=1)
    low, high = piece.positions.min(axis=0), piece.positions.max(axis=0)
    cell = (SHARED_CELLS * ((a + b + c) / 3 - low) / np.maximum(high - low, 1e-30)).astype(np.int64)
    x, y, z = np.clip(cell, 0, SHARED_CELLS - 1).T
    return 6 * (SHARED_CELLS * (SHARED_CELLS * x + y) + z) + 2 * axis + (normal[np.arange(len(normal)), axis] < 0)


def _scaled(
    laid: Sequence[Laid], scale: float, pad: int, brute: bool, pack: Callable[..., Packing]
) -> tuple[Packing, float]:
    """Pack all charts at a scale; also returns the edge of the square that they take, with padding."""
    packing = pack([(points * np.float32(scale), corners) for points, corners, _ in laid], pad, brute)
    return packing, packing.extent + pad + 1


def _collected(
    packing: Packing, pieces: Sequence[Piece], size: int, border: int, lit: np.ndarray, rest: Sequence[Panel]
) -> tuple[np.ndarray, np.ndarray]:
    uv = np.full((*lit.shape, 3, 2), NOWHERE, np.float32)
    chart = np.full(lit.shape, -1, np.int32)
    count = 0
    # The corner texel stays free for hidden triangles.
    places = [(points[corners] + np.float32(border)) / np.float32(size) for points, corners in packing.meshes]
    for k, piece in enumerate(pieces):
        points, corners = packing.meshes[k]
        place = places[k]
        numbers = components(corners.astype(np.int64), len(points))
        # The first piece of a triangle that is lit from its back only is the back.
        side = np.where(lit[0, piece.triangle], 0, 1) if piece.side == 0 else 1
        if piece.shared is not None:
            own = np.where(lit[0, piece.shared], 0, 1) if piece.side == 0 else 1
            uv[own, piece.shared] = place.mean(axis=1)
            chart[own, piece.shared] = count
        uv[side, piece.triangle] = place if piece.side == 0 else place[:, ::-1]
        chart[side, piece.triangle] = numbers + count
        count += int(numbers.max()) + 1
    collect(rest, places[len(pieces) :], uv, chart, count)
    return np.clip(uv, 0, 1), chart
