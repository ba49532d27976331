"""The table of emitters: closed forms of what it says of a lamp, and the chances of a choice."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.transport.emitter_table import EmitterTable
from lightwell.transport.resampling import chosen

pytestmark = pytest.mark.gpu


def scene_of(**emitters) -> mi.Scene:
    floor = {"type": "rectangle", "bsdf": {"type": "diffuse"}}
    return mi.load_dict({"type": "scene", "floor": floor, **emitters})


def light(value: float) -> dict:
    return {"type": "rgb", "value": [value] * 3}


def square(x: float, half: float, radiance: float) -> dict:
    """A square lamp at (x, 0, 2), which shines down."""
    turn = mi.ScalarTransform4f().translate([x, 0, 2]).rotate([1, 0, 0], 180).scale([half, half, 1])
    return {"type": "rectangle", "to_world": turn, "emitter": {"type": "area", "radiance": light(radiance)}}


def likely(table: EmitterTable, emitter: int, p, normal=(0.0, 0.0, 1.0), side: float = 1.0) -> float:
    found = table.likely(
        mi.UInt32(emitter), mi.Point3f(*map(float, p)), mi.Vector3f(*map(float, normal)), mi.Float(side)
    )
    return float(np.array(found)[0])


def test_lamps_far_away_bring_what_the_closed_form_says():
    # Irradiance below each, 10 m away: I / d².
    down = [0, 0, 10]
    ball = {"type": "sphere", "center": down, "radius": 0.1, "emitter": {"type": "area", "radiance": light(3)}}
    lamp = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate(down).rotate([1, 0, 0], 180).scale(0.1)}
    spot = {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(down, [0, 0, 0], [1, 0, 0]),
        "intensity": light(5),
        "cutoff_angle": 20.0,
        "beam_width": 19.0,
    }
    scenes = {
        "point": (scene_of(a={"type": "point", "position": down, "intensity": light(2)}), 2.0, 0.02),
        "sphere": (scene_of(a=ball), 3 * np.pi * 0.1**2, 0.02),
        "square": (scene_of(a=lamp | {"emitter": {"type": "area", "radiance": light(4)}}), 4 * 0.2**2, 0.02),
        "spot": (scene_of(a=spot), 5.0, 0.35),
    }
    for name, (scene, intensity, tolerance) in scenes.items():
        found = likely(EmitterTable.of(scene), 0, (0, 0, 0))
        assert found == pytest.approx(intensity / 100, rel=tolerance), name


def test_infinitely_far_lights_bring_the_same_everywhere():
    sun = {"type": "directional", "direction": [0, 0, -1], "irradiance": light(7)}
    sky = {"type": "constant", "radiance": light(2)}
    table = EmitterTable.of(scene_of(a=sun, b=sky))
    values = {emitter: [likely(table, emitter, p) for p in ((0, 0, 0), (0.5, 0.3, 0.2))] for emitter in (0, 1)}
    assert {round(np.ptp(v), 6) for v in values.values()} == {0.0}
    assert sorted(round(v[0], 2) for v in values.values()) == [round(2 * np.pi, 2), 7.0]


def test_backs_and_places_behind_bring_little():
    table = EmitterTable.of(scene_of(a=square(0, 0.1, 1)))
    front = likely(table, 0, (0, 0, 0))
    assert likely(table, 0, (0, 0, 4), (0, 0, -1)) < 0.02 * front
    assert likely(table, 0, (0, 0, 0), (0, 0, -1)) <= 0.1 * front
    # The other side of a sheet, as it is seen.
    assert likely(table, 0, (0, 0, 0), (0, 0, -1), -1.0) == pytest.approx(front, rel=1e-4)


def many(count: int) -> EmitterTable:
    lamps = {f"lamp {k}": square(0.3 * k, 0.05, [1.0, 0.0, 30.0][k % 3]) for k in range(count)}
    return EmitterTable.of(scene_of(**lamps, sky={"type": "constant", "radiance": light(0.1)}))


@pytest.mark.parametrize("count", [2, 12, 90])
def test_choices_are_even_by_weight(count):
    # One over the chance, counted where an emitter was chosen, has the mean 1 for each of them, dark ones included.
    table, lanes = many(count), 1 << 18
    it = dr.zeros(mi.Interaction3f, lanes)
    it.p, it.n = mi.Point3f(1.0, 0.0, 0.5), mi.Normal3f(0, 0, 1)
    number = mi.sample_tea_float32(dr.arange(mi.UInt32, lanes), mi.UInt32(9))
    size = dr.opaque(mi.UInt32, count + 1)
    emitter, weight, left = (np.array(v) for v in chosen(table, (mi.UInt32(0), size), it, number, mi.Bool(True)))
    assert 0 <= left.min() and left.max() < 1 and abs(left.mean() - 0.5) < 0.005
    means = np.array([np.where(emitter == k, weight, 0).mean() for k in range(count + 1)])
    errors = np.array([np.where(emitter == k, weight, 0).std() for k in range(count + 1)]) / np.sqrt(lanes)
    assert (np.abs(means - 1) < 5 * errors + 1e-3).all()
    # A planted bug: the brightest lamp of all counts 5 % too much.
    best = np.argmin(errors)
    assert abs(1.05 * means[best] - 1) > 5 * errors[best]


def test_the_lamp_close_by_is_chosen_most_often():
    table, lanes = many(12), 1 << 14
    it = dr.zeros(mi.Interaction3f, lanes)
    it.p, it.n = mi.Point3f(0.6, 0.0, 1.8), mi.Normal3f(0, 0, 1)
    number = mi.sample_tea_float32(dr.arange(mi.UInt32, lanes), mi.UInt32(9))
    emitter, *_ = chosen(table, (mi.UInt32(0), dr.opaque(mi.UInt32, 13)), it, number, mi.Bool(True))
    positions = np.array(table.place).reshape(-1, 4)[:, 0]
    near = int(np.argmin(np.abs(positions - 0.6)))
    assert np.bincount(np.array(emitter), minlength=13).argmax() == near


def test_dimmed_lamps_are_measured_again():
    from lightwell.core.lamps import parse_lamps
    from lightwell.scenes import load
    from lightwell.scenes.dimmed import dimmed
    from lightwell.scenes.lamps import group_lamps
    from lightwell.transport.emitter_table import emitter_table

    scene = load("loft")
    groups = group_lamps(scene, parse_lamps(("name",)))
    intensity = lambda: np.array(emitter_table(scene).lobe).reshape(-1, 4)[:, 3]  # noqa: E731
    before = intensity()
    with dimmed(scene, groups, {groups[0].name: (0.0, 0.0, 0.0)}):
        dark = intensity() == 0
        assert dark.sum() == len(groups[0].emitters)
    assert np.array_equal(intensity(), before)
