"""Bases of a volume mixed once a frame: by dimmers of lamps and by the pose of what moves; light of some emitters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from test_lattice_and_query import bricked, made_up

from lightwell.fields.field_and_probes.light import RoleProbes, most_bases
from lightwell.fields.probes.baked import storable
from lightwell.fields.probes.fit import PRESETS
from lightwell.graph import Builder, evaluate
from lightwell.graph.budget import BUDGET, check_budget, graph_work
from lightwell.graph.pose_basis import PoseBasis
from lightwell.probes.code import StateMix
from lightwell.probes.lower import lower
from lightwell.probes.spline import SplineMix
from lightwell.probes.trace import air_light
from lightwell.scenes.assemble import assemble
from lightwell.scenes.scene import Material
from lightwell.scenes.sky import Sky
from lightwell.scenes.variables import Sun
from tests.transport.rooms import quad, room_walls


def mixed(mixing, bases: np.ndarray, *given: np.ndarray) -> np.ndarray:
    """[N, 27] bases [27 K] mixed by rows of the frame inputs."""
    b = Builder(position=3, **mixing.inputs)
    rows = b.linear("position", np.zeros((bases.size, 3)), bases)
    graph = b.build(out=mixing.mixed(b, rows))
    frame = {name: np.atleast_2d(np.float32(values)) for name, values in zip(mixing.inputs, given, strict=True)}
    return evaluate(graph, {"position": np.zeros((len(given[0]), 3), np.float32), **frame})["out"]


def by_hand(mix: np.ndarray, nodes: tuple[tuple[float, ...], ...], pose: np.ndarray) -> np.ndarray:
    """[N, G, K] factors at poses [N, M], interpolated with SciPy between those [P, G, K] of the nodes."""
    grid = mix.reshape(*(len(own) for own in nodes), *mix.shape[1:])
    return RegularGridInterpolator(nodes, grid)(pose)


@pytest.mark.parametrize("volume", [made_up(), bricked()], ids=["plain", "bricks"])
def test_a_page_can_evaluate_the_probes_of_every_preset(volume):
    rng = np.random.default_rng(0)
    light = rng.normal(size=(30, 3)).astype(np.float32)

    def graph(count: int):
        mixing = SplineMix.of(light, np.zeros((30, 0)), rng.normal(size=(30, count)), directions=True)
        return lower(volume, 1.0, rng.normal(size=(*volume.light.shape, count)).astype(np.float32), mixing)

    counts = {preset.bases_of(volume) for preset in PRESETS.values()}
    for count in counts:
        check_budget(graph(count))
    # Of several lights at once, each with probes of its own.
    for lights in range(1, 6):
        count = min(most_bases(lights, volume.bricks is not None), max(counts))
        assert lights * graph_work(graph(count)) <= BUDGET.work


def test_probes_beside_a_small_lamp_are_within_half_floats():
    volume = made_up()
    basis = volume.light[..., None].copy()
    probe = int(np.flatnonzero(volume.alive)[0])
    basis[probe] *= 1e6
    made = RoleProbes(volume, basis, None, 1.0, "zh3", {})
    x, n = np.float32([volume.lattice.nodes()[probe]]), np.float32([[0, 1, 0]])
    found = evaluate(made.lower(), {"position": x, "normal": n})["radiance"]
    assert np.isfinite(found).all()
    even = storable(basis)
    assert np.array_equal(np.delete(even, probe, axis=0), np.delete(basis, probe, axis=0))
    assert np.abs(even[probe, 0]).max() == pytest.approx(6e4)
    np.testing.assert_allclose(even[probe] / even[probe, 0, 0], basis[probe] / basis[probe, 0, 0], rtol=1e-5)


@pytest.mark.parametrize("nodes", [((0.0, 0.2, 0.7, 1.0),), ((0.0, 0.4, 1.0), (0.0, 1.0)), ((0.0, 0.3, 1.0),) * 3])
def test_poses_are_interpolated_linearly(nodes):
    rng, poses = np.random.default_rng(0), PoseBasis(nodes)
    at = np.concatenate([poses.poses, rng.random((21, len(nodes)))])
    bases, mix = rng.standard_normal((27, 5)), rng.standard_normal((poses.count, 1, 5))
    expected = by_hand(mix, nodes, at)[:, 0] @ bases.T
    assert np.abs(mixed(StateMix(mix, poses), bases.ravel(), at) - expected).max() < 1e-4


@pytest.mark.parametrize("mix", [np.eye(2), np.random.default_rng(6).standard_normal((5, 2))])
def test_dimmers_and_colours_multiply_each_group(mix):
    # A basis for each group, or more groups than bases.
    rng, groups = np.random.default_rng(1), len(mix)
    even, rest = rng.standard_normal((3, 2)), rng.standard_normal((3, 8, 2))
    dimmers = rng.random((5, 3, groups))
    factors = np.einsum("gk,ncg->nck", mix, dimmers)
    mixing = StateMix(mix[None], lamps=True)
    rows = dimmers.reshape(5, 3 * groups)
    found = mixed(mixing, np.concatenate([even.ravel(), rest.ravel()]), rows)
    np.testing.assert_allclose(found[:, :3], np.einsum("ck,nck->nc", even, factors), atol=1e-5)
    np.testing.assert_allclose(found[:, 3:], np.einsum("chk,nck->nch", rest, factors).reshape(5, 24), atol=1e-5)


def test_dimmers_multiply_each_group_in_the_pose():
    rng, nodes = np.random.default_rng(2), ((0.0, 0.3, 1.0), (0.0, 1.0))
    even, rest, mix = rng.standard_normal((3, 4)), rng.standard_normal((3, 8, 4)), rng.standard_normal((6, 2, 4))
    dimmers, at = rng.random((5, 3, 2)), rng.random((5, 2))
    factors = np.einsum("ngk,ncg->nck", by_hand(mix, nodes, at), dimmers)
    mixing = StateMix(mix, PoseBasis(nodes), lamps=True)
    found = mixed(mixing, np.concatenate([even.ravel(), rest.ravel()]), dimmers.reshape(5, 6), at)
    np.testing.assert_allclose(found[:, :3], np.einsum("ck,nck->nc", even, factors), atol=1e-5)
    np.testing.assert_allclose(found[:, 3:], np.einsum("chk,nck->nch", rest, factors).reshape(5, 24), atol=1e-5)


@pytest.mark.parametrize("movers", [0, 1, 3])
def test_the_spline_of_a_light_passes_through_its_states(movers):
    rng = np.random.default_rng(3)
    light, pose, factors = rng.uniform(1, 4, (40, 3)), rng.random((40, movers)), rng.standard_normal((40, 5))
    mix, bases = SplineMix.of(light, pose, factors, directions=False), rng.standard_normal((27, 5))
    assert mix.inputs == {"light": 3} | ({"pose": movers} if movers else {})
    frame = (light, pose) if movers else (light,)
    np.testing.assert_allclose(mix.factors(*frame), factors, atol=2e-3)
    np.testing.assert_allclose(mixed(mix, bases.ravel(), *frame), factors @ bases.T, atol=2e-2)
    # Linear functions are reproduced everywhere.
    slope = rng.standard_normal((3 + movers, 2))
    linear = SplineMix.of(light, pose, np.concatenate([light, pose], axis=1) @ slope, directions=False)
    at = rng.uniform(1, 4, (9, 3)), rng.random((9, movers))
    found = linear.factors(*at) if movers else linear.factors(at[0])
    np.testing.assert_allclose(found, np.concatenate(at, axis=1) @ slope, atol=5e-3)


def test_a_spline_with_levels_passes_through_its_states_and_spreads_no_bright_one():
    rng = np.random.default_rng(5)
    light = rng.uniform(-1, 1, (60, 3))
    # Light grows by e^6 towards one wall.
    level = lambda at: np.exp(6 * at[:, :1])  # noqa: E731
    wave = lambda at: np.concatenate([np.sin(at), np.cos(at)], axis=1) * level(at)  # noqa: E731
    mix = SplineMix.of(light, np.zeros((60, 0)), wave(light), directions=False, levels=True)
    found = mix.factors(light)
    error = np.linalg.norm(found - wave(light), axis=1) / np.linalg.norm(wave(light), axis=1)
    assert error.max() < 0.02
    between = rng.uniform(-0.7, 0.7, (200, 3))
    size = np.linalg.norm(wave(between), axis=1)
    plain = SplineMix.of(light, np.zeros((60, 0)), wave(light), directions=False)
    apart = np.median(np.linalg.norm(mix.factors(between) - wave(between), axis=1) / size)
    together = np.median(np.linalg.norm(plain.factors(between) - wave(between), axis=1) / size)
    assert apart < 0.1 and together > 3 * apart, f"{apart:.3f} with levels, {together:.3f} without"


@pytest.mark.parametrize("height", [0.0, 0.4])
def test_the_spline_of_directions_on_a_circle_follows_them(height):
    # All in a plane: of an environment map that turns, height 0, or of an arc.
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = lambda a: np.stack([np.sin(a), np.full_like(a, height), -np.cos(a)], axis=1)  # noqa: E731
    wave = lambda a: np.stack([np.sin(a), np.cos(2 * a), np.sin(3 * a + 1)], axis=1)  # noqa: E731
    mix = SplineMix.of(ring(turn), np.zeros((24, 0)), wave(turn), directions=True)
    between = turn + np.pi / 24
    np.testing.assert_allclose(mix.factors(ring(between)), wave(between), atol=0.05)


@pytest.fixture(scope="module")
def panels():
    """A closed room with a red and a blue panel, and a lamp."""
    walls = [*room_walls(), quad("front", (-1, 0, 1), (0, 2, 0), (2, 0, 0))]
    lit = [
        quad("red", (-0.98, 0.6, -0.4), (0, 0.6, 0), (0, 0, 0.8), material=1),
        quad("blue", (0.98, 0.6, -0.4), (0, 0, 0.8), (0, 0.6, 0), material=2),
    ]
    white = Material("white", base_color=(0.6, 0.6, 0.6, 1.0), metallic=0.0)
    shining = [Material("r", emissive=(4.0, 0.0, 0.0)), Material("b", emissive=(0.0, 0.0, 4.0))]
    return assemble("room", [*walls, *lit], [white, *shining], digest="panels")


def test_light_of_emitters_alone_adds_up_to_all(panels):
    at = np.array([[0.0, 1.0, 0.0], [-0.5, 0.5, 0.3]])
    n = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    red, blue, both = (air_light(panels, at, 1 << 14, 5, normals=n, emitters=e).irradiance for e in ((0,), (1,), ()))
    assert red[:, 0].min() > 0.05 and blue[:, 2].min() > 0.05
    assert not red[:, 2].any() and not blue[:, 0].any()
    # 16,384 paths: about 1 % of noise.
    np.testing.assert_allclose((red + blue)[:, [0, 2]], both[:, [0, 2]], rtol=0.08)


def test_the_sky_of_a_day_arrives_in_the_air_and_its_sun_does_not():
    # A black floor under a white sky of level 1: radiance 1 / 2 π from above, so that E is 1/2 upwards, 1/4 sideways.
    black = Material("black", base_color=(0.0, 0.0, 0.0, 1.0), metallic=0.0, ior=1.0)
    floor = assemble("floor", [quad("floor", (-50, 0, -50), (0, 0, 100), (100, 0, 0))], [black], digest="floor")
    model = ((0, 0, 1, 0, 0, 0, 0, 0, 0) * 3,) * 2
    ways = ((0.9, 0.1, 0.42), (0.0, 1.0, 0.0), (-0.9, 0.1, 0.42))
    for sunlight in (0.0, 3.0):
        level = 2 * np.pi + sunlight
        sun = Sun(*ways, sky=Sky((0.0, 1.0), ((sunlight,) * 3,) * 2, model, (level,) * 2, 3.0))
        at, n = np.tile([[0.0, 1.0, 0.0]], (2, 1)), np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
        light = np.array([0.0, 1.0, 0.0], np.float32)
        found = air_light(floor, at, 1 << 13, 3, normals=n, variable=sun, light=light).irradiance
        wanted = np.array([[np.pi], [np.pi / 2]]) / level
        np.testing.assert_allclose(found, np.broadcast_to(wanted, (2, 3)), rtol=0.03)
