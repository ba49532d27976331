"""Rays, diffusion, fits, solve and incremental bakes, on rooms of which the answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from leak_scenes import two_rooms

from lightwell.probes import ddgi, rays, sh
from lightwell.probes.bake import bake_geometry, rebake, with_bricks
from lightwell.probes.diffusion import LEAST, REACH, diffuse
from lightwell.probes.fallbacks import fallbacks, sealed, spread
from lightwell.probes.light import light_volume, refined, relit
from lightwell.probes.pattern import pattern
from lightwell.probes.samples import ProbeSampling, path_factors, rows
from lightwell.probes.solve import SolveRows, smape, solve
from lightwell.probes.support import cube_edges, cube_valid, sees
from lightwell.probes.volume import OPEN, WEIGHTED, coefficients, query, trust_at
from lightwell.probes.weights import FUNCTIONS, error, point_weight, refine, trusted

OFFSET = (0.3, 0.1, 0.7)


@pytest.fixture(scope="module")
def rooms():
    return two_rooms(0.05, door=True)


@pytest.fixture(scope="module")
def baked(rooms):
    return bake_geometry(rooms.scene, 1.0, "relu-field", OFFSET)


def test_places_in_walls_and_outside_are_not_air(rooms):
    places = np.array([[-1.5, 1.3, 1.5], [0, 2.3, 0.5], [0, 1.0, 1.4], [-1.5, 1.3, 5.0]], np.float32)
    assert rays.valid(rooms.scene, places).tolist() == [True, False, True, False]


def test_segments_stop_at_a_wall_of_a_centimetre():
    thin = two_rooms(0.01)
    a, b = np.float32([[-0.5, 1, 1], [-0.5, 1, 1]]), np.float32([[0.5, 1, 1], [-0.1, 1, 1]])
    assert rays.free(thin.scene, a, b).tolist() == [False, True]


def sweeps(pattern, sees, edges, count, reach=REACH):
    """``diffuse`` by plain iteration, one cube at a time: [B, Q] trust."""
    out = np.zeros(sees.shape)
    first, second, _, number = pattern.cube_edges.T
    for cube, (seen, open_) in enumerate(zip(sees, edges)):
        i, j, w = first[open_], second[open_], pattern.weights()[number[open_]]
        rho, degree = seen.astype(float), np.zeros(len(seen))
        np.add.at(degree, i, w)
        np.add.at(degree, j, w)
        for _ in range(count):
            total = np.zeros(len(seen))
            np.add.at(total, i, w * rho[j])
            np.add.at(total, j, w * rho[i])
            mean = np.divide(total, degree, out=np.zeros_like(total), where=degree > 0)
            rho = np.where(seen, 1.0, mean / (1 + pattern.decay(reach)))
        out[cube] = np.where(rho < LEAST, 0, rho)
    return out


def test_diffusion_solves_what_the_sweeps_approach(rooms, baked):
    nodes = np.flatnonzero(baked.volume.state == WEIGHTED)[:2]
    seen, edges = sees(rooms.scene, baked.support, nodes), cube_edges(baked.support, nodes)
    layout = baked.support.pattern
    assert np.abs(diffuse(layout, seen, edges) - sweeps(layout, seen, edges, count=300)).max() < 1e-3


def test_trust_decays_by_e_over_the_reach():
    layout = pattern()
    seen = np.broadcast_to(layout.u[:, 0] < -0.5, (1, len(layout.u)))
    rho = diffuse(layout, seen, np.ones((1, len(layout.cube_edges)), bool), reach=0.33)[0]
    layer = lambda x: rho[np.abs(layout.u[:, 0] - x) < 0.06].mean()  # noqa: E731
    assert np.log(layer(-0.25) / layer(0.08)) == pytest.approx(1.0, rel=0.12)


def test_trust_does_not_cross_a_wall(rooms):
    closed = two_rooms(0.05)
    made = bake_geometry(closed.scene, 1.0, "relu-field", OFFSET)
    layout, lattice = made.support.pattern, made.support.lattice
    nodes = np.flatnonzero(made.support.alive)
    left = made.support.origin[nodes][:, 0] < 0
    x = lattice.nodes()[nodes][:, None, 0] + layout.u[None, :, 0]
    wrong = np.where(left[:, None], x > 0.03, x < -0.03)
    assert (made.target[nodes] * wrong).max() == 0


@pytest.mark.parametrize("function", ["relu-field", pytest.param("relu-field-5", marks=pytest.mark.slow)])
def test_the_convex_fit_is_as_good_as_many_steps_of_adam(baked, function):
    weighted = np.flatnonzero(baked.volume.state == WEIGHTED)[:3]
    layout, f = baked.support.pattern, FUNCTIONS[function]
    target, valid = baked.target[weighted].astype(np.float32), cube_valid(baked.support, weighted)
    weight = point_weight(target, layout.hat, valid)
    score = lambda params: (weight * (trusted(f.values(params, layout.u)[0]) - target) ** 2).mean()  # noqa: E731
    fitted = f.fit(target, weight, layout)
    newton = score(fitted)
    start = np.full((len(target), f.parameters), 0.5, np.float32)
    adam = score(refine(f, start, target, weight, layout, steps=200, rate=0.03, points=512))
    found = f.quantised(fitted)
    plain = error(target, np.ones_like(target), layout.hat, valid).mean()
    assert newton < 1.25 * adam
    assert error(target, trusted(f.values(found, layout.u)[0]), layout.hat, valid).mean() < 0.5 * plain


@pytest.mark.parametrize("function", list(FUNCTIONS))
def test_gradients_are_right(function):
    f, rng = FUNCTIONS[function], np.random.default_rng(2)
    params = f.initial(2) if function == "mlp" else rng.uniform(0.1, 0.9, (2, f.parameters)).astype(np.float32)
    u, slope = rng.uniform(-1, 1, (40, 3)), rng.normal(size=(2, 40))
    _, state = f.values(params.astype(np.float64), u)
    gradient = f.gradient(state, slope)
    for k in (0, f.parameters // 2, f.parameters - 1):
        moved = [params.astype(np.float64).copy() for _ in range(2)]
        for sign, p in zip((1, -1), moved):
            p[:, k] += sign * 1e-4
        up, down = (f.values(p, u)[0] for p in moved)
        expected = ((up - down) * slope).sum(axis=1) / 2e-4
        assert np.allclose(gradient[:, k], expected, rtol=2e-2, atol=2e-3)


def test_a_furnace_is_pi_everywhere(baked):
    light = np.zeros((len(baked.volume.lattice), 9, 3))
    light[:, 0] = np.sqrt(4 * np.pi) * np.pi
    rng = np.random.default_rng(0)
    x = rng.uniform([-2.9, 0.1, 0.1], [-0.1, 2.5, 2.9], (300, 3))
    e, z = query(baked.volume.lit(light * baked.volume.alive[:, None, None]), x, sh.directions(300))
    assert np.abs(e[z > 0.05] / np.pi - 1).max() < 1e-3 and (z > 0.05).mean() > 0.99


def test_the_solve_recovers_light_that_the_probes_can_show(baked):
    volume, rng = baked.volume, np.random.default_rng(1)
    truth = rng.normal(0, 0.1, volume.light.shape).astype(np.float32)
    truth[:, 0] += 2
    truth[~volume.alive] = 0
    x = rng.uniform([-2.9, 0.1, 0.1], [2.9, 2.5, 2.9], (4000, 3))
    from lightwell.probes.volume import coefficients

    node, share, _ = coefficients(volume, x, np.zeros_like(x))
    light = np.einsum("nk,nkbc->nbc", share, truth[node])
    start = truth + rng.normal(0, 0.3, truth.shape).astype(np.float32) * volume.alive[:, None, None]
    found = solve(volume, SolveRows(x, np.zeros_like(x), light), start)
    assert found.errors[-1] < 0.3 * found.errors[0] and np.isfinite(found.light).all()
    states = solve(
        volume, SolveRows(x, np.zeros_like(x), np.stack([light, 2 * light])), np.stack([start, 2 * start])
    ).light
    assert np.allclose(states[1], 2 * states[0], rtol=1e-3, atol=1e-3)


def test_smape_is_bounded_and_symmetric():
    a, b = np.array([1.0, 0.0, 4.0]), np.array([3.0, 5.0, 4.0])
    assert np.allclose(smape(a, b, 1e-9), [0.5, 1, 0]) and np.allclose(smape(a, b, 1e-9), smape(b, a, 1e-9))


def test_a_rebake_of_nothing_changes_nothing_and_touches_little(rooms, baked):
    box = np.array([[-2.5, 0.2, 0.2], [-2.2, 0.5, 0.5]])
    after, nodes = rebake(rooms.scene, baked, box)
    assert 0 < len(nodes) < 0.1 * len(baked.volume.lattice)
    for name in ("state", "row", "params", "octant", "fallback"):
        assert np.array_equal(getattr(after.volume, name), getattr(baked.volume, name)), name


def test_a_rebake_of_a_shut_door_is_the_full_bake(baked):
    closed = two_rooms(0.05, door=True, shut=True)
    whole = bake_geometry(closed.scene, 1.0, "relu-field", OFFSET)
    box = np.array([[-0.03, 0, 0.95], [0.03, 2.05, 1.95]])
    after, _ = rebake(closed.scene, baked, box)
    assert np.array_equal(after.volume.state, whole.volume.state)
    for name in ("row", "params", "octant", "fallback"):
        assert np.array_equal(getattr(after.volume, name), getattr(whole.volume, name)), name
    for name in ("row", "plane", "corners"):
        assert np.array_equal(getattr(after.volume.sheets, name), getattr(whole.volume.sheets, name)), name


def test_bricks_are_baked_again_where_a_box_touches_them(rooms, baked):
    closed = two_rooms(0.05, door=True, shut=True)
    cells = np.unique(
        baked.volume.lattice.cell_number(baked.volume.lattice.locate(np.array([[0, 1, 1.4], [2, 1, 1]]))[0])
    )
    before = with_bricks(rooms.scene, baked, cells)
    box = np.array([[-0.03, 0, 0.95], [0.03, 2.05, 1.95]])
    after, _ = rebake(closed.scene, before, box)
    whole = with_bricks(closed.scene, bake_geometry(closed.scene, 1.0, "relu-field", OFFSET), cells)
    assert len(after.volume.state) > len(after.volume.lattice)
    for name in ("state", "row", "params", "octant", "fallback"):
        assert np.array_equal(getattr(after.volume, name), getattr(whole.volume, name)), name


def test_an_incremental_bake_of_the_light_keeps_what_it_does_not_touch(rooms, baked):
    lit = light_volume(rooms.scene, baked, ProbeSampling(4, 8, 8), 3)
    box = np.array([[-0.03, 0, 0.95], [0.03, 2.05, 1.95]])
    same, solved = relit(rooms.scene, lit, box)
    assert len(solved) == 0 and np.array_equal(same.volume.light, lit.volume.light)
    assert np.array_equal(same.samples.light, lit.samples.light) and np.array_equal(same.number, lit.number)
    after, solved = relit(two_rooms(0.05, door=True, shut=True).scene, lit, box)
    changed = np.flatnonzero((after.volume.light != lit.volume.light).any(axis=(1, 2)))
    assert len(changed) and set(changed) <= set(solved.tolist()) | set(np.flatnonzero(~after.volume.alive))
    assert np.isfinite(after.volume.light).all()


def test_bricks_stand_where_the_error_is(rooms, baked):
    lit = light_volume(rooms.scene, baked, ProbeSampling(8, 32, 64), 3)
    fine = refined(rooms.scene, lit, 2.0)
    assert fine.volume.bricks is not None
    added = len(fine.volume.state) - len(fine.volume.lattice)
    assert added <= 64 / 42 * 2.0 * lit.volume.alive.sum()
    score = lambda of: np.maximum(lit.solution.residual - lit.samples.noise, 0)[of].mean()  # noqa: E731
    inside = fine.volume.bricks.cell[lit.samples.cell] >= 0
    assert score(inside) > 1.7 * score(~inside)


def test_moments_see_a_wall(rooms, baked):
    light = np.zeros_like(baked.volume.light)
    moments = ddgi.bake_moments(rooms.scene, baked.support, light)
    d = sh.directions(64)
    assert np.allclose(ddgi.octahedral(ddgi.to_octahedral(d)), d, atol=1e-6)
    assert (moments.maps[..., 1] + 1e-3 >= moments.maps[..., 0] ** 2).all()


def test_what_is_shut_in_has_no_fallback(baked):
    level, state = baked.levels[0], baked.records[0].state
    support, lattice = level.support, level.support.lattice
    cells = np.arange(lattice.cell_count)
    # Walls of blocks are no air: every octant keeps what it asks.
    assert not sealed(level, state, cells).any()
    assert (fallbacks(level, state, baked.first, cells) == spread(support, baked.first, cells)).all()
    # The same wall of sheets with two sides: its inside is air that no probe is trusted at and no edge leads to.
    hollow = replace(level, support=support.copy())
    place = support.points(cells)
    inside = (np.abs(place[..., 0]) < 0.025) & ~support.valid
    inside &= np.all((place > [-1, 0.1, 0.1]) & (place < [1, 1.9, 0.9]), axis=2)
    hollow.support.valid[:] |= inside
    shut = sealed(hollow, state, cells)
    octant = (support.pattern.points >= 0.5) @ np.array([1, 2, 4])
    many = np.stack([(inside & (octant == o)).sum(axis=1) for o in range(8)], axis=1) >= 2
    assert many.any() and (shut == many).all()
    made = fallbacks(hollow, state, baked.first, cells)
    assert (made[shut] == -1).all() and (made[~shut] == spread(support, baked.first, cells)[~shut]).all()
    # One edge out, and it is a place like any other behind a corner.
    hollow.support.free[:] = True
    assert not sealed(hollow, state, cells)[many].all()


def test_an_open_room_needs_no_records():
    room = two_rooms(0.05)
    made = bake_geometry(room.scene, 1.0, "relu-field", OFFSET)
    far = made.support.lattice.nodes()[:, 0] < -1.2
    assert set(made.volume.state[far & made.volume.alive]) == {OPEN}
    x = np.array([[-2.0, 1.3, 1.5]])
    assert trust_at(made.volume, x)[2].max() == 1


def test_noisy_light_is_not_taken_for_dark_light(baked):
    rng = np.random.default_rng(4)
    x = rng.uniform([-2.9, 0.1, 0.1], [2.9, 2.5, 2.9], (6000, 3))
    light = np.zeros((len(x), 9, 3))
    # Skewed, as few paths find a door.
    light[:, 0] = rng.gamma(3, 1 / 3, (len(x), 1))
    start = np.zeros(baked.volume.light.shape, np.float32)
    start[baked.volume.alive, 0] = 1
    found = solve(baked.volume, SolveRows(x, np.zeros_like(x), light), start)
    node, share, _ = coefficients(baked.volume, x, np.zeros_like(x))
    assert (share * found.light[node, 0, 0]).sum(axis=1).mean() == pytest.approx(light[:, 0].mean(), rel=0.01)


def test_noisy_cells_get_more_paths(rooms, baked):
    noise, cell = np.array([0.01, 0.05, 0.3, 0.3, 0.09, 0.09]), np.array([5, 5, 2, 2, 9, 9])
    assert path_factors(noise, cell, 16).tolist() == [1, 1, 16, 16, 8, 8] and path_factors(noise, cell, 1).max() == 1
    few, many = (rows(rooms.scene, baked, ProbeSampling(4, 16, 16, most=most), 3)[0] for most in (1, 16))
    assert np.array_equal(few.place, many.place) and many.noise.mean() < 0.5 * few.noise.mean()


def test_what_has_been_traced_without_bricks_is_not_traced_again(rooms, baked):
    lit = light_volume(rooms.scene, baked, ProbeSampling(8, 16, 16, most=4), 3)
    fine = refined(rooms.scene, lit, 2.0)
    whole = light_volume(rooms.scene, fine.geometry, lit.sampling, lit.seed)
    assert len(fine.volume.state) > len(baked.volume.state)
    for found, expected in ((fine.samples, whole.samples), (fine, whole), (fine.solution, whole.solution)):
        for name in ("light", "noise", "cell", "place", "number", "start", "residual"):
            if isinstance(getattr(expected, name, None), np.ndarray):
                assert np.array_equal(getattr(found, name), getattr(expected, name)), name
