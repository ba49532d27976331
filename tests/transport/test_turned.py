"""An environment map that turns: the path tracer against Mitsuba's, the gather against it, refusals in one line."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.scenes.default_light import under_sky
from lightwell.scenes.lamps import own_lights
from lightwell.scenes.placing import held_out_lights, sample_lights
from lightwell.scenes.turning import Turning
from lightwell.scenes.variables import declare, from_json, to_json
from lightwell.transport import direct, draw_surface, indirect
from lightwell.transport.environment import with_turning
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings
from lightwell.transport.turned_light import TurnedShards, turned_cells
from tests.transport.rooms import WHITE, box, build, diffuse

TURN = ("environment.rotation=0..360",)
ANGLES = (0.0, 70.0, 290.0)


def court(angle: float = 0.0):
    """A box on the ground beside a wall, under a map with a bright spot and a gradient, turned clockwise."""
    boxes = {
        "ground": ((-2, -0.1, -2), (2, 0, 2)),
        "wall": ((-1, 0, -1.2), (1, 1.5, -1)),
        "block": ((0,) * 3, (0.5,) * 3),
    }
    scene = build("court", [box(name, *corners) for name, corners in boxes.items()], [diffuse(WHITE)] * 3)
    texels = np.full((16, 32, 3), 0.3, np.float32)
    texels[:, :, 0] += np.sin(np.linspace(0, 2 * np.pi, 32)) ** 2
    texels[4:6, 9:11] = (20, 16, 8)
    # Mitsuba turns counterclockwise seen from above.
    turned = mi.ScalarTransform4f().rotate([0, 1, 0], -angle)
    map_ = {"type": "envmap", "bitmap": mi.Bitmap(texels), "to_world": turned}
    shapes = {f"mesh_{k:06d}": shape for k, shape in enumerate(scene.mi.shapes())}
    lamp = {"type": "point", "position": [0.0, 3.0, 0.0], "intensity": 2.0}
    scene.mi = mi.load_dict({"type": "scene", **shapes, "sky": map_, "lamp": lamp}, optimize=False)
    return scene


@pytest.fixture(scope="module")
def turning():
    return with_turning(court(), TURN)


def only_map(scene):
    """The same scene without its lamp."""
    shapes = {f"mesh_{k:06d}": shape for k, shape in enumerate(scene.mi.shapes())}
    scene.mi = mi.load_dict({"type": "scene", **shapes, "sky": scene.mi.environment()}, optimize=False)
    return scene


def test_the_map_is_no_longer_an_emitter_of_the_scene(turning):
    assert [light.name for light in own_lights(turning)] == ["light 0"]
    assert turning.surrounding is not None and turning.digest != court().digest
    variable = declare((*TURN, "environment.intensity=2"), turning)
    assert variable == Turning(0, 360) and from_json(to_json(variable)) == variable
    assert to_json(variable)["initial"] == pytest.approx([0, 0, -1])
    points = draw_surface(turning, 8, 1).points
    assert not direct(turning, points, variable.direction(20.0), variable).any()


def test_light_of_a_turned_map_is_that_of_mitsubas(turning):
    from lightwell.transport import static

    variable, points = declare(TURN, turning), draw_surface(turning, 256, 7).points
    for angle in ANGLES:
        a, b = indirect(turning, points, variable.direction(angle), variable, 256, 3)
        truth = sum(static(only_map(court(angle)), points, 256, 5)) / 2
        found = (a + b) / 2
        # The noise of both is about 2 % of the mean of the points; a turn the wrong way differs by 20 %.
        assert found.mean(axis=0) == pytest.approx(truth.mean(axis=0), rel=0.03)
        assert np.median(np.abs(found - truth)) < 0.05 * truth.mean()


def test_cells_of_a_turned_map_hold_its_light():
    random = np.random.default_rng(1)
    picture = random.random((96, 192, 3)).astype(np.float32)
    cells = turned_cells(picture, np.array([0.0, 90.0, 360.0]))
    area = np.sin(np.pi * (np.arange(96) + 0.5) / 96)
    mean = np.average(picture.mean(axis=1), axis=0, weights=area)
    np.testing.assert_allclose(cells.mean(axis=1), np.tile(mean, (3, 1)), rtol=1e-4)
    # A quarter turn moves columns by a quarter: clockwise is from -Z to +X, where columns begin.
    by_column = cells.reshape(3, -1, 96, 3)
    np.testing.assert_allclose(by_column[1], np.roll(by_column[0], 24, axis=1), rtol=1e-4)
    np.testing.assert_allclose(by_column[2], by_column[0], rtol=1e-4)


def test_shards_have_the_light_of_paths(turning):
    variable = declare(TURN, turning)
    settings = ShardSettings(lights=64, points_per_light=32, paths=64, floor=1)
    make = TurnedShards(turning, variable, settings, GatherSize(8192, 2048, 64, 128))
    columns, counts = make(turning, variable, None, settings, 0)
    found = (columns["half_a"] + columns["half_b"]) / 2
    rows = SurfacePoints(columns["shape"], columns["triangle"], columns["barycentric"], columns["view"])
    truth = sum(indirect(turning, rows, columns["light"], variable, 64, 4)) / 2
    assert counts["paths"]["paths"] == 8192 * 128 + 2048 * 64
    assert found.mean(axis=0) == pytest.approx(truth.mean(axis=0), rel=0.04)
    assert np.median(np.abs(found - truth)) < 0.1 * truth.mean()
    again, _ = make(turning, variable, None, settings, 0)
    np.testing.assert_array_equal(again["half_a"], columns["half_a"])


def test_angles_are_directions_and_back(turning):
    variable = Turning(-30, 300)
    angles = np.linspace(-30, 300, 50)
    np.testing.assert_allclose(variable.angle(variable.direction(angles)), angles, atol=1e-6)
    assert variable.angle(variable.direction(np.array([310.0, 325.0]))).tolist() == [300, -30]
    np.testing.assert_allclose(variable.direction(90.0), [1, 0, 0], atol=1e-12)
    assert Turning(20, 90).initial == 20
    lights = [make(turning, variable, 64, 3) for make in (sample_lights, held_out_lights)]
    for found in lights:
        assert found.shape == (64, 3) and np.ptp(variable.angle(found)) > 300
    assert not set(map(tuple, lights[0])) & set(map(tuple, lights[1]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("environment.rotation=90", "expected FIRST..LAST in degrees; write for example environment.rotation=0..360"),
        ("environment.rotation=90..0", "the first angle is not below the last one"),
        ("environment.rotation=0..720", "angles lie between -360 and 360 degrees"),
        ("environment.rotation=a..b", "expected FIRST..LAST"),
        ("environment.rotation=nan..1", "expected FIRST..LAST"),
    ],
)
def test_a_wrong_range_is_one_line_with_a_cure(turning, text, message):
    with pytest.raises(ValueError, match=r"^vary: [^\n]+$") as error:
        declare((text,), turning)
    assert message in str(error.value)


def test_scenes_without_a_map_and_even_skies_are_refused_in_one_line():
    bare = build("bare", [box("box", (0, 0, 0), (1, 1, 1))], [diffuse(WHITE)])
    with pytest.raises(ValueError, match=r"^vary: scene 'bare' has no environment map that could turn; add an [^\n]+$"):
        with_turning(bare, TURN)
    with pytest.raises(
        ValueError, match=r"^vary: the environment of scene 'bare' does not change when it turns; [^\n]+$"
    ):
        with_turning(under_sky(bare), TURN)
    assert with_turning(bare, ("light.radius=0.1",)) is bare
    with pytest.raises(ValueError, match=r"^vary: environment.rotation is for bake, compare and render"):
        declare(TURN, bare)
    with pytest.raises(ValueError, match=r"^vary: one light can vary here, not the environment and light.radius"):
        declare((*TURN, "light.radius=0.1"), with_turning(court(), TURN))
