"""Bases of a volume mixed once a frame: by dimmers of lamps and by the pose of what moves; light of some emitters."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.graph import Builder, evaluate
from lightwell.probes.code import LampMix, PosedLampMix, PoseMix
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


def test_poses_are_interpolated_linearly():
    poses, at = (0.0, 0.2, 0.7, 1.0), np.linspace(0, 1, 21)
    bases = np.random.default_rng(0).standard_normal((27, len(poses)))
    expected = np.stack([np.interp(at, poses, row) for row in bases], axis=1)
    assert np.abs(mixed(PoseMix(poses), bases.ravel(), at[:, None]) - expected).max() < 1e-5


def test_dimmers_and_colours_multiply_each_group():
    rng = np.random.default_rng(1)
    even, rest = rng.standard_normal((3, 2)), rng.standard_normal((3, 8, 2))
    dimmers = rng.random((5, 3, 2))
    found = mixed(LampMix(2), np.concatenate([even.ravel(), rest.ravel()]), dimmers.reshape(5, 6))
    np.testing.assert_allclose(found[:, :3], np.einsum("ck,nck->nc", even, dimmers), atol=1e-5)
    np.testing.assert_allclose(found[:, 3:], np.einsum("chk,nck->nch", rest, dimmers).reshape(5, 24), atol=1e-5)


def test_dimmers_multiply_each_group_in_the_pose():
    rng, poses, at = np.random.default_rng(2), (0.0, 0.3, 1.0), np.array([0.0, 0.15, 0.3, 0.65, 1.0])
    even, rest, mix = rng.standard_normal((3, 4)), rng.standard_normal((3, 8, 4)), rng.standard_normal((3, 2, 4))
    dimmers = rng.random((5, 3, 2))
    between = np.stack([[np.interp(at, poses, row) for row in group] for group in mix.transpose(1, 2, 0)])
    factors = np.einsum("gkn,ncg->nck", between, dimmers)
    found = mixed(
        PosedLampMix(poses, mix), np.concatenate([even.ravel(), rest.ravel()]), dimmers.reshape(5, 6), at[:, None]
    )
    np.testing.assert_allclose(found[:, :3], np.einsum("ck,nck->nc", even, factors), atol=1e-5)
    np.testing.assert_allclose(found[:, 3:], np.einsum("chk,nck->nch", rest, factors).reshape(5, 24), atol=1e-5)


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
