"""The atlas of a light map: a place of its own in one square texture for every lit side of every triangle.

Charts are cut and packed by xatlas; the author's second set of texture coordinates is taken where it is valid.

Notation: T triangles of all meshes behind one another; side 0 is the front (the geometric normal's), 1 the back; uv in
[0, 1]², v downwards, texel (i, j) of an atlas of size n covers [j, j + 1] x [i, i + 1] / n.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from lightwell.scenes.scene import Mesh, Scene

# A bilinear read at mip level m reaches this many texels of that level beyond its point: half a texel to the farther
# centre, one between the centres.
REACH = 1.5
# More charts than this on 1024 x 1024 are packed by xatlas' fast method: brute force takes seconds per thousand there,
# and minutes on larger squares.
BRUTE_CHARTS = 700
# Rounds that fit the packing into its square, and the step back when it is too large.
FIT_ROUNDS, SHRINK = 6, 0.985
# Coverage of the square by charts that is worth more rounds, what each of them asks less than the one before, and how
# many there are.
GOAL, GOAL_STEP, GOAL_ROUNDS = 0.71, 0.002, 12
# Edge of the square, in texels, that charts are cut for: xatlas lays them out in texels.
CUT_EDGE = 900.0
# Share of the covered texels that may be covered twice.
TWICE = 5e-4
# Charts that would cover less than this share of the square do not fit: xatlas drops what becomes too small.
LEAST_COVERAGE = 0.03
# Charts of fewer texels share one small triangle with their likes (same mesh, side and direction): its edge in texels.
TINY, SHARED_EDGE = 4.0, 2.0
# Texels per metre of sides of which little is seen, relative to the others.
FAINT = 0.25
# Hidden triangles lie on the texel in this corner, which no chart uses.
NOWHERE = 0.0


@dataclass(frozen=True)
class Atlas:
    """Where the light of every lit side is stored."""

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
    """Who made it, and why: for the report."""

    @property
    def charts(self) -> int:
        """Number of charts."""
        return int(self.chart.max()) + 1

    @property
    def coverage(self) -> float:
        """Share of the square that lies inside triangles, padding not counted."""
        a, b, c = (self.uv[self.chart >= 0][:, k].astype(np.float64) for k in range(3))
        return float(np.abs(_cross(b - a, c - a)).sum() / 2)

    def lookup(self, shape: np.ndarray, triangle: np.ndarray, barycentric: np.ndarray, side: np.ndarray) -> np.ndarray:
        """[N, 2] float32: uv of surface points named by mesh, triangle, barycentric weights [N, 2] and side."""
        corners = self.uv[side, self.first[shape] + triangle]
        b = np.asarray(barycentric, np.float32)
        weights = np.stack([1 - b[:, 0] - b[:, 1], b[:, 0], b[:, 1]], axis=1)
        return np.einsum("nk,nkc->nc", weights, corners)


def padding(mips: int) -> int:
    """Texels that a chart owns around itself so that bilinear reads up to a mip level stay its own; half a texel more
    for charts that end between texel centres."""
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
) -> Atlas:
    """The atlas of a scene.

    lit       [2, T] bool: sides that are seen and get light; others are not stored.
    dark      [2, T] bool: sides that are seen and get none, or must not get any from the light map (clear glass); they
              lie on the corner that no chart uses. All other sides that are not stored read what the other side reads.
    density   [M] texels per metre of each mesh relative to the others; None: all alike.
    faint     [2, T] bool: large sides of which little is seen; they get fewer texels.
    own       Take the author's second texture coordinates where they are valid.
    """
    first = np.cumsum([0] + [len(mesh.indices) for mesh in scene.meshes])
    if not lit.any():
        raise ValueError(f"atlas: no side of scene '{scene.name}' is seen and lit; is a light on?")
    reason = "no second texture coordinates"
    if own and all(mesh.uv1 is not None for mesh in scene.meshes):
        reason = own_fault(scene, size, lit, mips)
        if not reason:
            return _authored(scene, size, lit, mips, first)
    pieces = _pieces(scene, lit, density, np.zeros_like(lit) if faint is None else faint)
    uv, chart = _packed(pieces, size, padding(mips), lit)
    return Atlas(size, mips, _both(uv, chart, dark), chart, first, f"xatlas ({reason})")


def _both(uv: np.ndarray, chart: np.ndarray, dark: np.ndarray | None) -> np.ndarray:
    """A side that is not stored reads where the other one is stored, unless it is seen to be dark."""
    for side in (0, 1):
        borrowed = (chart[side] < 0) & (chart[1 - side] >= 0)
        borrowed &= True if dark is None else ~dark[side]
        uv[side, borrowed] = uv[1 - side, borrowed]
    return uv


# ---------------------------------------------------------------------- charts


@dataclass(frozen=True)
class _Piece:
    """Triangles of one mesh and side, with vertices welded by position."""

    positions: np.ndarray
    indices: np.ndarray
    triangle: np.ndarray
    """[K] number in the concatenation."""
    side: int
    shared: np.ndarray | None = None
    """Numbers of triangles that all read the middle of the only triangle of this piece."""


def _pieces(scene: Scene, lit: np.ndarray, density: np.ndarray | None, faint: np.ndarray) -> list[_Piece]:
    """Per mesh, the triangles that are lit from any side, then those that are lit from both once more, turned round;
    those that are faint there by themselves."""
    pieces, start = [], 0
    # Of a triangle that is lit from its back alone, the first piece is the back.
    shown = (np.where(lit[0], faint[0], faint[1]), faint[1])
    for number, mesh in enumerate(scene.meshes):
        here = np.arange(start, start + len(mesh.indices))
        start += len(mesh.indices)
        scale = 1.0 if density is None else float(density[number])
        welded, inverse = np.unique(mesh.positions, axis=0, return_inverse=True)
        corners = inverse.reshape(-1)[mesh.indices.astype(np.int64)]
        for side, wanted in ((0, lit[:, here].any(axis=0)), (1, lit[:, here].all(axis=0))):
            for few in (False, True):
                chosen = wanted & (shown[side][here] == few)
                if not chosen.any():
                    continue
                turned = corners[chosen] if side == 0 else corners[chosen][:, ::-1]
                used, compact = np.unique(turned, return_inverse=True)
                positions = np.ascontiguousarray(welded[used] * np.float32(scale * (FAINT if few else 1.0)))
                pieces.append(_Piece(positions, compact.reshape(-1, 3).astype(np.uint32), here[chosen], side))
    return pieces


def _packed(pieces: Sequence[_Piece], size: int, pad: int, lit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """uv [2, T, 3, 2] and charts [2, T] of all pieces in one square."""
    flat, charts = _cut(pieces)
    total = sum(_area(points, corners) for points, corners in flat)
    scale = np.sqrt(0.6 * size * size / max(total, 1e-30))
    pieces, flat = _merged(pieces, flat, scale)
    best = _fitted(flat, size, pad, scale)
    if best is None or total * best[0] ** 2 < LEAST_COVERAGE * size * size:
        raise ValueError(
            f"atlas: {charts} charts with {pad} texels of padding do not fit into {size} x {size} texels; "
            "give a larger --size or fewer --mips"
        )
    return _collected(best[1], pieces, size, pad + 1, lit)


def _cut(pieces: Sequence[_Piece]) -> tuple[list[tuple[np.ndarray, np.ndarray]], int]:
    """(points, corners) of every piece laid out in the plane, in one unit, and the number of charts.

    Every piece has an atlas to itself: xatlas 0.0.11 works on a first mesh in a thread of its own while it is given a
    second one, and moves the list of meshes under that thread, which crashes the process once in a few hundred atlases.
    """
    import xatlas

    area = sum(_surface(piece) for piece in pieces)
    texels = CUT_EDGE / np.sqrt(max(area, 1e-30))
    flat, charts = [], 0
    for piece in pieces:
        cut = xatlas.Atlas()
        cut.add_mesh(piece.positions, piece.indices)
        cut.generate(xatlas.ChartOptions(), _options(texels, 0, False))
        flat.append(_flat(cut, 0))
        charts += cut.chart_count
    return flat, charts


def _surface(piece: _Piece) -> float:
    """Square metres of a piece."""
    a, b, c = (piece.positions[piece.indices[:, k]].astype(np.float64) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _fitted(flat, size: int, pad: int, scale: float):
    """(scale, packing) of the largest scale found that fits the square; None where none does.

    What the packer leaves free at the borders changes by a tenth from one scale to the next, and at some scales it lays
    a chart over another.
    """
    brute, best = sum(f[2] for f in flat) * (size / 1024) ** 3 <= BRUTE_CHARTS, None
    area = sum(_area(points, corners) for points, corners, _ in flat)
    for attempt in range(2 * FIT_ROUNDS):
        if best is not None and attempt >= FIT_ROUNDS:
            break
        packed, extent = _pack(flat, scale, pad, brute)
        if extent <= size and (best is None or scale > best[0]) and _apart(packed, len(flat)):
            best = (scale, packed)
        if SHRINK * size < extent <= size:
            break
        step = (size - 3 * pad) / max(extent - 3 * pad, 1) if packed.atlas_count == 1 else 0.7
        if best is not None and scale * step * SHRINK <= best[0]:
            break
        scale *= step * (SHRINK if extent > size else 1.0)
    coverage = 0.0 if best is None else area * best[0] ** 2 / size**2
    for wanted in GOAL - GOAL_STEP * np.arange(GOAL_ROUNDS):
        if wanted <= coverage:
            break
        scale = np.sqrt(wanted * size * size / area)
        packed, extent = _pack(flat, scale, pad, brute)
        if extent <= size and _apart(packed, len(flat)):
            return scale, packed
    return best


def _apart(packed, count: int) -> bool:
    """Whether no chart of a packing lies over another; ``count`` meshes."""
    corners = [points[rows] for points, rows in (_flat(packed, k) for k in range(count))]
    hits = coverings(np.concatenate(corners), packed.width + 1, packed.height + 1)
    return int((hits > 1).sum()) <= TWICE * int((hits > 0).sum())


def coverings(corners: np.ndarray, width: int, height: int) -> np.ndarray:
    """[height, width] how many triangles [K, 3, 2] cover each texel's centre; of a shared edge, one of its two does."""
    corners = corners.astype(np.float64) - 0.5
    low = np.clip(np.ceil(corners[..., 1].min(axis=1)), 0, height).astype(np.int64)
    high = np.clip(np.ceil(corners[..., 1].max(axis=1)), 0, height).astype(np.int64)
    count = high - low
    row = np.repeat(np.arange(len(corners)), count)
    y = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + low[row]
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for k in range(3):
        # Always from the lower end, so that both triangles of an edge find the same place.
        ends = corners[:, [k, (k + 1) % 3]]
        order = np.lexsort((ends[..., 0], ends[..., 1]), axis=1)
        p, q = (np.take_along_axis(ends, order[:, [j]][..., None], axis=1)[:, 0][row] for j in (0, 1))
        meets = (p[:, 1] <= y) & (q[:, 1] > y)
        x = p[:, 0] + (q[:, 0] - p[:, 0]) * ((y - p[:, 1]) / np.where(meets, q[:, 1] - p[:, 1], 1.0))
        left, right = np.where(meets, np.minimum(left, x), left), np.where(meets, np.maximum(right, x), right)
    some = np.isfinite(left)
    hits = np.zeros((height, width + 1), np.int32)
    for x, sign in ((left, 1), (right, -1)):
        np.add.at(hits, (y[some], np.clip(np.ceil(x[some]), 0, width).astype(np.int64)), sign)
    return hits.cumsum(axis=1)[:, :width]


def _options(texels: float, pad: int, brute: bool):
    import xatlas

    options = xatlas.PackOptions()
    options.padding, options.texels_per_unit, options.bruteForce = pad, texels, brute
    options.resolution, options.bilinear, options.rotate_charts = 0, True, True
    return options


def _flat(atlas, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of piece k in the plane, in units of its mesh, and corners [K, 3]."""
    _, corners, uv = atlas.get_mesh(k)
    return np.ascontiguousarray(uv * [atlas.width, atlas.height], np.float32), np.ascontiguousarray(corners)


def _area(points: np.ndarray, corners: np.ndarray) -> float:
    a, b, c = (points[corners[:, k]].astype(np.float64) for k in range(3))
    return float(np.abs(_cross(b - a, c - a)).sum() / 2)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _merged(pieces: Sequence[_Piece], flat, scale: float):
    """Pieces and (points, corners, charts) in which tiny charts have become one small triangle for each direction."""
    made, laid = [], []
    for piece, (points, corners) in zip(pieces, flat):
        chart = _components(corners.astype(np.int64), len(points))
        a, b, c = (points[corners[:, k]].astype(np.float64) for k in range(3))
        area = np.abs(_cross(b - a, c - a)) / 2 * scale * scale
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
            corner = np.float32([[0, 0], [edge, 0], [0, edge]])
            laid.append((corner, np.arange(3, dtype=np.uint32)[None], 1))
    return made, laid


def _direction(piece: _Piece) -> np.ndarray:
    """[K] which of the six directions along the axes each triangle's normal is nearest to."""
    a, b, c = (piece.positions[piece.indices[:, k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    axis = np.abs(normal).argmax(axis=1)
    return 2 * axis + (normal[np.arange(len(normal)), axis] < 0)


def _pack(flat: Sequence[tuple[np.ndarray, np.ndarray, int]], scale: float, pad: int, brute: bool):
    import xatlas

    atlas = xatlas.Atlas()
    for points, corners, _ in flat:
        atlas.add_uv_mesh(np.ascontiguousarray(points * np.float32(scale)), corners)
    atlas.generate(xatlas.ChartOptions(), _options(1.0, pad, brute))
    extent = max(atlas.width, atlas.height) + pad + 1 if atlas.atlas_count == 1 else np.inf
    return atlas, extent


def _collected(
    atlas, pieces: Sequence[_Piece], size: int, border: int, lit: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    uv = np.full((*lit.shape, 3, 2), NOWHERE, np.float32)
    chart = np.full(lit.shape, -1, np.int32)
    count = 0
    for k, piece in enumerate(pieces):
        points, corners = _flat(atlas, k)
        # The texel in the corner stays free: it is nowhere.
        place = (points[corners] + np.float32(border)) / np.float32(size)
        numbers = _components(corners.astype(np.int64), len(points))
        # Of a triangle that is lit from its back alone, the first piece is the back.
        side = np.where(lit[0, piece.triangle], 0, 1) if piece.side == 0 else 1
        if piece.shared is not None:
            own = np.where(lit[0, piece.shared], 0, 1) if piece.side == 0 else 1
            uv[own, piece.shared] = place.mean(axis=1)
            chart[own, piece.shared] = count
        uv[side, piece.triangle] = place if piece.side == 0 else place[:, ::-1]
        chart[side, piece.triangle] = numbers + count
        count += int(numbers.max()) + 1
    return np.clip(uv, 0, 1), chart


def _components(corners: np.ndarray, count: int) -> np.ndarray:
    """[K] number of the connected part that each triangle belongs to, from 0."""
    rows, columns = corners[:, [0, 1]].reshape(-1), corners[:, [1, 2]].reshape(-1)
    links = coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), (count, count))
    _, label = connected_components(links, directed=False)
    return np.unique(label[corners[:, 0]], return_inverse=True)[1].reshape(-1)


# ---------------------------------------------------------------------- the author's own

# Share of covered texels that may be hit twice.
OVERLAP = 0.005


def _own_corners(scene: Scene) -> np.ndarray:
    return np.concatenate([mesh.uv1[mesh.indices.astype(np.int64)] for mesh in scene.meshes]).astype(np.float32)


def own_fault(scene: Scene, size: int, lit: np.ndarray, mips: int) -> str:
    """What keeps the author's second texture coordinates from being used; empty when nothing does."""
    uv = _own_corners(scene)
    stored = lit.any(axis=0)
    if not np.isfinite(uv).all():
        return "the author's second texture coordinates contain NaN or infinity"
    if uv[stored].min() < 0 or uv[stored].max() > 1:
        return "the author's second texture coordinates leave [0, 1]"
    if (lit[0] & lit[1]).any():
        return "sheets are lit from both sides, which the author's coordinates do not tell apart"
    area = np.abs(_cross(uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]))
    if (area[stored] <= 0).any():
        return f"{int((area[stored] <= 0).sum())} triangles have no area in the author's second texture coordinates"
    hits, owner = _hits(uv[stored], _author_charts(scene)[stored], size)
    covered = max(int((hits > 0).sum()), 1)
    if (shared := int((hits > 1).sum())) > OVERLAP * covered:
        return f"{shared / covered:.1%} of the author's texels are used twice"
    gap = _gap(owner)
    if gap < 2:
        return f"charts of the author's second texture coordinates come within {gap:.0f} texel(s) at {size} x {size}"
    return ""


def _author_charts(scene: Scene) -> np.ndarray:
    """[T] connected parts of the author's coordinates: corners of one mesh that share both place and uv."""
    labels, count = [], 0
    for mesh in scene.meshes:
        key = np.concatenate([mesh.positions, mesh.uv1], axis=1)
        _, inverse = np.unique(key, axis=0, return_inverse=True)
        corners = inverse.reshape(-1)[mesh.indices.astype(np.int64)]
        labels.append(_components(corners, int(inverse.max()) + 1) + count)
        count = int(labels[-1].max()) + 1
    return np.concatenate(labels)


def _hits(uv: np.ndarray, chart: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """[n, n] how many triangles cover each texel's centre, and the chart of the last one (-1: none)."""
    hits, owner = np.zeros((size, size), np.int32), np.full((size, size), -1, np.int32)
    for corners, number in zip(uv.astype(np.float64) * size, chart):
        low = np.maximum(np.floor(corners.min(axis=0) - 0.5), 0).astype(int)
        high = np.minimum(np.ceil(corners.max(axis=0) + 0.5), size).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        a, b, c = corners
        sign = 1.0 if _cross(b - a, c - a) > 0 else -1.0
        inside = np.ones(x.shape, bool)
        for p, q in ((a, b), (b, c), (c, a)):
            edge = sign * ((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]))
            # A texel centre on a shared edge belongs to one of its two triangles.
            inside &= (edge > 0) | ((edge == 0) & _owns(p, q, sign))
        hits[low[1] : high[1], low[0] : high[0]][inside] += 1
        owner[low[1] : high[1], low[0] : high[0]][inside] = number
    return hits, owner


def _owns(p: np.ndarray, q: np.ndarray, sign: float) -> bool:
    """Top-left rule of rasterisers."""
    d = sign * (q - p)
    return bool(d[1] > 0 or (d[1] == 0 and d[0] < 0))


def _gap(owner: np.ndarray) -> float:
    """Smallest distance between texels of different charts, less the texel itself."""
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
    # Nowhere is the corner that no chart uses; the author may use it, so dark sides read the other side there.
    both = _both(np.stack([uv, uv]), chart, None)
    own_gap = _gap(_hits(uv[lit.any(axis=0)], numbers[lit.any(axis=0)], size)[1])
    safe = max((m for m in range(mips + 1) if 2 * padding(m) <= own_gap), default=0)
    return Atlas(size, safe, both, chart, first, "the author's second texture coordinates")


# ---------------------------------------------------------------------- what is written


def charted_meshes(scene: Scene, atlas: Atlas) -> list[Mesh]:
    """The scene's meshes with ``uv1`` from the atlas, vertices split along chart borders; a sheet whose sides differ
    becomes two meshes of opposite winding."""
    made = []
    for number, mesh in enumerate(scene.meshes):
        rows = slice(atlas.first[number], atlas.first[number + 1])
        twice = (atlas.chart[0, rows] >= 0) & (atlas.uv[0, rows] != atlas.uv[1, rows]).any(axis=(1, 2))
        made.append(_charted(mesh, mesh.indices, _main_uv(atlas, rows), mesh.name))
        if twice.any():
            turned = mesh.indices[twice][:, ::-1]
            back = _charted(mesh, turned, atlas.uv[1, rows][twice][:, ::-1], f"{mesh.name} (back)")
            made.append(replace(back, normals=None if back.normals is None else -back.normals))
    return made


def _main_uv(atlas: Atlas, rows: slice) -> np.ndarray:
    front, back = atlas.uv[:, rows]
    return np.where((atlas.chart[0, rows] >= 0)[:, None, None], front, back)


def _charted(mesh: Mesh, indices: np.ndarray, uv: np.ndarray, name: str) -> Mesh:
    """One vertex for every distinct (vertex, uv)."""
    corner = indices.astype(np.int64).reshape(-1)
    key = np.concatenate([corner[:, None].astype(np.float64), uv.reshape(-1, 2)], axis=1)
    found, inverse = np.unique(key, axis=0, return_inverse=True)
    source = found[:, 0].astype(np.int64)
    take = lambda a: None if a is None else a[source]  # noqa: E731
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
