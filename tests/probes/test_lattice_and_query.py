"""The lattice, the weight functions and the query, against closed forms and against the shading graph."""

from dataclasses import replace

import numpy as np
import pytest

from lightwell.graph import compile, evaluate
from lightwell.probes import bricks, sh
from lightwell.probes.lattice import ProbeLattice, default_spacing
from lightwell.probes.lower import lower
from lightwell.probes.pattern import octants, pattern
from lightwell.probes.sheets import Sheets
from lightwell.probes.volume import DROPPED, OPEN, WEIGHTED, ProbeVolume, coefficients, explain, query
from lightwell.probes.weights import FUNCTIONS

LATTICE = ProbeLattice(np.array([-1.0, 0.3, 2.0]), 0.7, (5, 4, 6))


def unit(v):
    return (v / np.linalg.norm(v, axis=1, keepdims=True)).astype(np.float32)


def made_up(function: str = "relu-field", lattice: ProbeLattice = LATTICE, seed: int = 0) -> ProbeVolume:
    """A volume of random weights and light: a definition is tested on nonsense, too."""
    rng = np.random.default_rng(seed)
    f, count = FUNCTIONS[function], len(lattice)
    state = rng.integers(0, 3, count).astype(np.uint8)
    weighted = np.flatnonzero(state == WEIGHTED)
    row = np.full(count, -1, np.int32)
    row[weighted] = np.arange(len(weighted))
    params = f.quantised(rng.normal(0.3, 0.6, (len(weighted), f.parameters)).astype(np.float32))
    light = rng.normal(0, 0.4, (count, 9, 3)).astype(np.float32)
    light[:, 0] = 3 + rng.random((count, 3))
    light[state == DROPPED] = 0
    # The nearest nodes by free paths lie round the cell.
    at = lattice.cell_corner(np.arange(lattice.cell_count))[:, None] + rng.integers(-1, 3, (lattice.cell_count, 8, 3))
    back = np.where((at >= 0).all(axis=2) & (at < lattice.shape).all(axis=2), lattice.node_number(at), -1).astype(
        np.int32
    )
    back[(back >= 0) & (state[np.maximum(back, 0)] == DROPPED)] = -1
    masks = rng.integers(0, 2**63, len(weighted), dtype=np.uint64)
    sheets = Sheets.of_cells(*random_planes(lattice.cell_count, rng))
    return ProbeVolume(lattice, function, state, row, params, masks, back, light, sheets)


def random_planes(count: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """Planes through the middles of a third of the cells, and the corners that count on their sides."""
    normal = unit(rng.standard_normal((count, 3)))
    planes = np.column_stack([normal, -(normal * rng.uniform(0.3, 0.7, (count, 3))).sum(axis=1)])
    planes[rng.random(count) > 1 / 3] = 0
    return planes.astype(np.float16), rng.integers(0, 1 << 16, count).astype(np.uint16)


def bricked(function: str = "relu-field", seed: int = 0) -> ProbeVolume:
    """The same with bricks in some cells."""
    plain, rng = made_up(function, seed=seed), np.random.default_rng(seed)
    nodes, table = bricks.layout(LATTICE, np.array([0, 1, 7, 12, 19, 33]))
    state = np.concatenate([plain.state, rng.integers(0, 3, len(nodes)).astype(np.uint8)])
    more, f = int((state[len(LATTICE) :] == WEIGHTED).sum()), FUNCTIONS[function]
    light = rng.normal(0, 0.4, (len(nodes), 9, 3)).astype(np.float32)
    light[:, 0] = 3 + rng.random((len(nodes), 3))
    light[state[len(LATTICE) :] == DROPPED] = 0
    planes, corners = random_planes(table.sheet.size, rng)
    has = planes.any(axis=1)
    first = len(plain.sheets.plane)
    sheet = np.where(has, first + np.cumsum(has) - 1, -1).reshape(table.sheet.shape).astype(np.int32)
    sheets = replace(
        plain.sheets,
        plane=np.concatenate([plain.sheets.plane, planes[has].astype(np.float32)]),
        corners=np.concatenate([plain.sheets.corners, corners[has]]),
    )
    return replace(
        plain,
        sheets=sheets,
        state=state,
        row=np.where(state == WEIGHTED, np.cumsum(state == WEIGHTED) - 1, -1).astype(np.int32),
        params=np.concatenate([plain.params, f.quantised(rng.normal(0.3, 0.6, (more, f.parameters)))]).astype(
            np.float32
        ),
        octant=np.concatenate([plain.octant, rng.integers(0, 2**63, more, dtype=np.uint64)]),
        light=np.concatenate([plain.light, light]),
        bricks=replace(table, sheet=sheet),
    )


def test_light_has_no_seam_at_the_face_of_a_brick():
    volume, n = bricked(), np.array([[0.0, 0, 1]])
    middle = LATTICE.origin + LATTICE.spacing * (LATTICE.cell_corner(np.array([12]))[0] + 0.5)
    volume = replace(volume, state=np.where(volume.state == WEIGHTED, OPEN, volume.state), offset=0.0)
    for axis in range(3):
        for side in (-1, 1):
            face = middle.copy()
            face[axis] += side * 0.5 * LATTICE.spacing
            a, b = face.copy(), face.copy()
            a[axis], b[axis] = a[axis] - 1e-6, b[axis] + 1e-6
            found = query(volume, np.stack([a, b]), np.repeat(n, 2, axis=0))[0]
            assert np.abs(found[0] - found[1]).max() < 1e-3


def test_a_brick_changes_only_its_own_cell():
    volume = bricked()
    x, n = queries(2000)
    inside = volume.bricks.cell[LATTICE.cell_number(LATTICE.locate(x + volume.offset * LATTICE.spacing * n)[0])] >= 0
    plain = replace(volume, bricks=None)
    differs = np.abs(query(volume, x, n)[0] - query(plain, x, n)[0]).max(axis=1) > 1e-6
    assert differs[inside].mean() > 0.2 and not differs[~inside].any()


def queries(count: int, seed: int = 1):
    rng = np.random.default_rng(seed)
    low, high = LATTICE.nodes().min(axis=0) - 0.5, LATTICE.nodes().max(axis=0) + 0.5
    return rng.uniform(low, high, (count, 3)).astype(np.float32), unit(rng.standard_normal((count, 3)))


def opened(volume: ProbeVolume) -> ProbeVolume:
    state, none = np.full(len(volume.lattice), OPEN, np.uint8), Sheets.none(volume.lattice.cell_count)
    return replace(volume, state=state, sheets=none)


def test_a_lattice_reaches_a_whole_cell_beyond_the_surfaces():
    for offset in ((0, 0, 0), (0.99, 0.5, 0.01)):
        lattice = ProbeLattice.around(np.array([[0, 0, 0], [3, 2, 1.5]]), 0.5, offset)
        nodes = lattice.nodes()
        assert (nodes.min(axis=0) <= -0.5 + 1e-9).all() and (
            nodes.max(axis=0) >= np.array([3.5, 2.5, 2.0]) - 1e-9
        ).all()


@pytest.mark.parametrize("edges", [(8, 4, 8), (8, 8, 8), (42.3, 3, 18.8), (240, 22, 190), (100, 0, 100), (60, 1, 1)])
def test_flat_and_long_scenes_have_as_many_nodes_as_a_room(edges):
    bounds = np.array([(1.0, 2.0, 3.0), np.add(edges, (1.0, 2.0, 3.0))])
    room = len(ProbeLattice.around(np.array([(0, 0, 0), (8.0, 4.0, 8.0)]), 1.0))
    spacing = default_spacing(bounds, 8)
    count = len(ProbeLattice.around(bounds, spacing))
    # A rod would need them closer than is allowed.
    assert count >= room or spacing <= max(edges) / 8 / 4
    assert spacing <= max(edges) / 8 and count < 2 * room


def test_node_cells_and_corners_agree():
    nodes = np.arange(len(LATTICE))
    cells = LATTICE.node_cells(nodes)
    for corner in range(8):
        rows = cells[:, corner] >= 0
        middle = LATTICE.origin + LATTICE.spacing * (LATTICE.cell_corner(cells[rows, corner]) + 0.5)
        found, hat, _ = LATTICE.corners(middle)
        assert (found == nodes[rows, None]).any(axis=1).all() and np.allclose(hat, 1 / 8)


def test_hats_sum_to_one_inside():
    x, _ = queries(500)
    _, hat, u = LATTICE.corners(x)
    assert np.allclose(hat.sum(axis=1), 1) and np.abs(u).max() <= 1


def test_an_open_volume_is_trilinear_interpolation():
    volume = opened(made_up())
    x, n = queries(400)
    found, z = query(volume, x, n)
    y = x + volume.offset * LATTICE.spacing * n
    node, hat, _ = LATTICE.corners(y)
    expected = np.maximum(sh.evaluate(np.einsum("nk,nkbc->nbc", hat, volume.light[node]), n), 0)
    assert np.allclose(z, 1, atol=1e-6) and np.abs(found - expected).max() < 1e-5


def test_the_query_is_linear_in_the_light():
    volume = made_up()
    other = np.random.default_rng(5).normal(0, 0.2, volume.light.shape).astype(np.float32)
    x, n = queries(200)
    node, share, _ = coefficients(volume, x, n)
    part = lambda light: np.einsum("nk,nkbc->nbc", share, light[node])  # noqa: E731
    mixed = part(2 * volume.light + 3 * other)
    assert np.abs(mixed - 2 * part(volume.light) - 3 * part(other)).max() < 1e-5


def exactness(function: str) -> float:
    """A published form divides by the hat: rounding counts up to a thousandfold beside the faces of a cube."""
    return 1e-3 if function.startswith("bare") else 1e-5


@pytest.mark.parametrize("function", list(FUNCTIONS))
@pytest.mark.parametrize("make", [made_up, bricked])
def test_the_shading_graph_means_the_same(function, make):
    volume = make(function)
    x, n = queries(1500)
    expected, z = query(volume, x, n)
    graph = lower(volume)
    found = evaluate(graph, {"position": x, "normal": n})
    assert np.abs(found["trust"][:, 0] - z).max() < exactness(function)
    # Bands 1 and 2 are stored in bytes: half a step of each of eight numbers, at most 0.5 of a harmonic each.
    step = np.abs(volume.light[:, 1:]).max() / 127
    assert np.abs(np.pi * found["radiance"] - expected).max() < 4 * step + 100 * (exactness(function) - 1e-5)


def test_drjit_means_the_same():
    from lightwell.backend import mi

    x, n = queries(1000)
    graph = lower(made_up("mlp"))
    expected = evaluate(graph, {"position": x, "normal": n})["radiance"]
    columns = {k: [mi.Float(np.ascontiguousarray(c)) for c in v.T] for k, v in {"position": x, "normal": n}.items()}
    found = np.stack([np.array(c) for c in compile(graph)(columns)["radiance"]], axis=1)
    assert np.abs(found - expected).max() < 1e-5 * max(1, expected.max())


def test_a_planted_bug_in_the_fallback_shows():
    volume = made_up()
    x, n = queries(2000)
    wrong = replace(volume, fallback=np.roll(volume.fallback, 1, axis=0))
    assert np.abs(query(wrong, x, n)[0] - query(volume, x, n)[0]).max() > 0.1


def test_explain_adds_up():
    x, n = queries(1)
    parts = explain(made_up(), x[0], n[0])
    assert len(parts) == 9 and parts[-1]["state"] == "fallback"
    assert sum(p["share"] for p in parts) <= 1 + 1e-6


def test_the_pattern_is_the_same_in_every_cell():
    layout = pattern()
    assert len(layout.u) == 4096 and 25_000 < len(layout.cube_edges) < 35_000
    first, second, _, edge = layout.cube_edges.T
    length = np.linalg.norm(layout.u[first] - layout.u[second], axis=1)
    assert np.allclose(length, layout.length[edge])
    assert set(np.bincount(octants(layout.u), minlength=64).tolist()) <= set(range(52, 77))


@pytest.mark.parametrize("spacing", [0.0, -1.0, float("nan")])
def test_a_spacing_that_is_no_length_is_refused(spacing):
    with pytest.raises(ValueError, match="give metres, such as 1m"):
        ProbeLattice.around(np.array([[0, 0, 0], [1, 1, 1]]), spacing)


@pytest.mark.parametrize("function", list(FUNCTIONS))
@pytest.mark.parametrize("make", [made_up, bricked])
def test_the_device_query_means_the_same(function, make):
    import probe_device as device

    from lightwell.backend import mi

    volume = make(function)
    x, n = queries(1500)
    expected, z = query(volume, x, n)
    found, trust = device.learned(volume)(mi.Point3f(x.T.copy()), mi.Vector3f(n.T.copy()))
    assert np.abs(np.array(trust) - z).max() < exactness(function)
    # Where next to nothing is trusted, the division magnifies rounding.
    assert np.abs(np.array(found).T - expected)[z > 0.01].max() < exactness(function) * expected.max()


def test_the_baseline_of_distance_moments_means_the_same_on_the_device():
    import probe_device as device

    from lightwell.backend import mi
    from lightwell.probes import ddgi

    rng, count = np.random.default_rng(3), len(LATTICE)
    mean = rng.random((count, ddgi.SIDE, ddgi.SIDE)) * 0.7
    maps = np.stack([mean, mean**2 + 0.05], axis=-1).astype(np.float32)
    origin = (LATTICE.nodes() + rng.normal(0, 0.1, (count, 3))).astype(np.float32)
    moments = ddgi.Moments(LATTICE, origin, rng.random(count) > 0.2, maps, made_up().light)
    x, n = queries(1000)
    found = device.chebyshev(moments)(mi.Point3f(x.T.copy()), mi.Vector3f(n.T.copy()))[0]
    assert np.abs(np.array(found).T - ddgi.query(moments, x, n)).max() < 1e-4
