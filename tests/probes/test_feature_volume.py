"""The split grid and the feature volume: walls part nodes, air joins them, and the graph means the query."""

from dataclasses import replace

import numpy as np
import pytest
from leak_scenes import two_rooms

from lightwell.graph import evaluate
from lightwell.probes import sh
from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.solve import SolveRows
from lightwell.probes.split.cut import Cuts
from lightwell.probes.split.fit import fit_volume, rounded
from lightwell.probes.split.grid import grid_of, split_grid
from lightwell.probes.split.lower import lower
from lightwell.probes.split.volume import FeatureVolume, query

SPACING, WALL = 0.5, 0.05
# The wall stands in the middle of cells, near a face of them, and in a face.
OFFSETS = (0.0, 0.35, 0.48)


def made(offset: float, door: bool = False):
    scene = two_rooms(WALL, door=door).scene
    return split_grid(scene, ProbeLattice.around(scene.bounds, SPACING, (offset, 0.3, 0.7)))


@pytest.fixture(scope="module", params=OFFSETS)
def shut(request):
    return made(request.param)


@pytest.fixture(scope="module")
def doorway():
    return made(OFFSETS[1], door=True)


def across(count: int = 600, seed: int = 0):
    """Places on both sides of the wall, opposite each other."""
    rng = np.random.default_rng(seed)
    x = rng.uniform([0, 0.02, 0.02], [0, 2.58, 2.98], (count, 3))
    x[:, 0] = rng.uniform(WALL / 2 + 0.002, 0.3, count)
    return x * [-1, 1, 1], x


def shared(grid, a, b) -> np.ndarray:
    """[N] part of the weight that nodes common to two places have."""
    (p, u), (q, v) = grid.corners(a), grid.corners(b)
    same = p[:, :, None] == q[:, None, :]
    return np.where(same, np.minimum(u[:, :, None], v[:, None, :]), 0).sum(axis=(1, 2))


def air(support):
    return support.points(np.arange(support.lattice.cell_count))[support.valid].astype(np.float64)


def test_a_wall_shares_no_node_between_its_sides(shut):
    assert shared(shut[0], *across()).max() == 0


def test_every_place_in_air_has_nodes(shut):
    grid, support = shut
    weight = grid.corners(air(support))[1]
    assert np.allclose(weight.sum(axis=1), 1)
    assert (grid.corners(across()[0])[1].sum(axis=1) > 0).all()


def test_a_doorway_joins_the_rooms_and_the_wall_beside_it_parts_them(doorway):
    grid, support = doorway
    a, b = across(2000)
    through = (a[:, 1] < 1.5) & (a[:, 2] > 1.3) & (a[:, 2] < 1.6)
    beside = (a[:, 2] < 1.0 - 2 * SPACING + 0.3) | (a[:, 2] > 1.9 + 2 * SPACING - 0.2)
    assert shared(grid, a[through], b[through]).mean() > 0.3
    assert shared(grid, a[beside], b[beside]).mean() < 0.02
    # Without planes the wall leaks: what is measured is there to be found.
    whole = grid_of(support, Cuts(np.full(support.lattice.cell_count, -1, np.int32), np.zeros((0, 4))))
    assert shared(whole, a[beside], b[beside]).mean() > 0.2


def test_features_have_no_seam_in_the_air(doorway):
    grid, support = doorway
    table = np.random.default_rng(1).random(grid.count)
    x = air(support)
    x = x[(np.abs(x[:, 0]) > 0.6) & (x[:, 0] > -2.9) & (x[:, 0] < 2.9)]
    x = x[(x[:, 1:] > 0.1).all(axis=1) & (x[:, 1] < 2.5) & (x[:, 2] < 2.9)]
    axis = np.arange(len(x)) % 3
    lattice = grid.lattice
    face = np.rint((x - lattice.origin) / SPACING) * SPACING + lattice.origin
    rows = np.arange(len(x))
    below, above = x.copy(), x.copy()
    below[rows, axis], above[rows, axis] = face[rows, axis] - 1e-7, face[rows, axis] + 1e-7
    low, high = ((table[node] * weight).sum(axis=1) for node, weight in map(grid.corners, (below, above)))
    inside = (np.abs(face) < [2.95, 9, 9]).all(axis=1) & (face[:, 1] > 0.05) & (face[:, 1] < 2.55)
    inside &= (face[:, 2] > 0.05) & (face[:, 2] < 2.95) & (np.abs(face[:, 0]) > 0.1)
    assert inside.sum() > 500 and np.abs(low - high)[inside].max() < 1e-4


def lit(grid, support, light) -> FeatureVolume:
    """A volume of analytic light: ``light`` maps places [N, 3] to harmonics [N, 9, 3]."""
    x = air(support)[::8]
    rows = SolveRows(x, np.zeros_like(x), light(x).astype(np.float32))
    return fit_volume(grid, rows, 12)


def rooms(x):
    """A room a thousand times brighter than the other one, with light from a side."""
    e = np.zeros((len(x), 9, 3))
    e[:, 0], e[:, 2] = [3.0, 2.0, 1.0], [0.5, 0.4, 0.3]
    return e * np.where(x[:, 0] < 0, 1000, 1)[:, None, None]


def test_constant_light_is_exact_up_to_the_wall_of_a_dark_room(shut):
    volume = lit(*shut, rooms)
    for side, x in zip((-1, 1), across()):
        n = np.tile([float(side), 0, 0], (len(x), 1))
        truth = sh.evaluate(rooms(x), n)
        # Bytes: half a step of 1 / 127.
        assert np.abs(query(volume, x, n) / truth - 1).max() < 0.01


def test_light_that_varies_linearly_is_continued_to_walls(shut):
    grid, support = shut
    slope = lambda x: rooms(x) * (1 + 0.1 * x[:, 1] + 0.05 * x[:, 2])[:, None, None]  # noqa: E731
    volume, (a, _) = lit(grid, support, slope), across()
    n = np.tile([0.0, 1, 0], (len(a), 1))
    found, truth = query(volume.in_air(), a, n), sh.evaluate(slope(a), n)
    assert np.abs(found / truth - 1).max() < 0.03


def test_features_are_scaled_with_the_light(shut):
    bright = lit(*shut, lambda x: 1e4 * rooms(x))
    x = across()[1]
    n = np.tile([0.0, 0, 1], (len(x), 1))
    assert np.allclose(query(bright, x, n), 1e4 * query(lit(*shut, rooms), x, n), rtol=0.02)


def test_light_has_no_seam_where_air_crosses_a_plane(doorway):
    """Places in a doorway on both sides of a plane beyond the end of its wall; without the openings there is a step."""
    grid, support = doorway
    assert len(grid.openings)
    cell, place = grid.openings[:, 0].astype(np.int64), grid.openings[:, 1:]
    at = grid.lattice.origin + SPACING * (grid.lattice.cell_corner(cell) + place)
    step = 1e-4 * grid.cuts.plane[grid.cuts.row[cell], :3]
    slope = lambda x: rooms(x * [0, 1, 1] + 1) * (1 - np.tanh(4 * x[:, 0]) / 2)[:, None, None]  # noqa: E731
    jump = []
    for tried in (grid, replace(grid, openings=np.zeros((0, 4)))):
        volume = lit(tried, support, slope)
        low, high = (volume.harmonics(at + way)[:, 0, 0, 0] for way in (-step, step))
        jump.append(np.abs(high - low).mean() / low.mean())
    assert jump[0] < 0.5 * jump[1] and jump[0] < 0.03


def random_volume(grid, rank: int = 1, features: int = 5) -> FeatureVolume:
    rng = np.random.default_rng(3)
    decoder = rng.normal(size=(27 * rank, features)).astype(np.float16).astype(np.float32)
    return FeatureVolume(grid, rounded(rng.normal(size=(grid.count, features))), decoder)


def test_the_graph_means_the_query(doorway):
    grid, support = doorway
    volume = random_volume(grid)
    rng = np.random.default_rng(5)
    x = rng.uniform(grid.lattice.origin - 0.2, support.points(np.arange(3))[0, 0] + [6.5, 3.2, 3.6], (3000, 3))
    n = rng.standard_normal((3000, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    x, n = x.astype(np.float32), n.astype(np.float32)
    expected = query(volume, x, n) / np.pi
    found = evaluate(lower(volume), {"position": x, "normal": n})["radiance"]
    # A place within rounding of a plane or a face may be on either side of it.
    assert (np.abs(found - expected).max(axis=1) > 1e-3).sum() <= 2 and expected.max() > 1


def test_bytes_are_counted(doorway):
    grid, _ = doorway
    volume = random_volume(grid)
    parts = volume.bytes
    assert parts["features"] == 7 * grid.count and parts["decoder"] == 2 * 27 * 5
    odd, sides = grid.irregular
    assert 0 < odd < (grid.first >= 0).sum() and sides >= odd
    assert parts["tables"] > len(grid.lattice) + grid.lattice.cell_count
    assert replace(volume, offset=0.0).bytes == parts
