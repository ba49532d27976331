"""Groups of a scene's own lights: by name, by rules, and the errors of rules."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.core.lamps import parse_lamps
from lightwell.scenes.assemble import assemble
from lightwell.scenes.dimmed import dimmed
from lightwell.scenes.lamps import group_lamps
from lightwell.scenes.load import load
from lightwell.scenes.scene import Light, Material, Mesh, Scene
from lightwell.transport.environment import environment_picture
from tests.transport.rooms import quad

GLOW = Material("Glow", emissive=(1.0, 1.0, 1.0))
FLOOR = quad("floor", (-1, 0, -1), (0, 0, 2), (2, 0, 0), material=1)


def lit(*names: str, spots: int = 0) -> Scene:
    """A floor under emissive quads of these names, and spots."""
    shining = [quad(name, (0.1 * k, 1, 0), (0.05, 0, 0), (0, 0, 0.05)) for k, name in enumerate(names)]
    lights = [Light("point", f"Spot.{k:03d}", (0.0, 1.0, 0.1 * k)) for k in range(spots)]
    meshes: list[Mesh] = [FLOOR, *shining]
    return assemble("room", meshes, [GLOW, Material("plain", metallic=0.0)], lights=lights, digest="room")


def grouped(scene: Scene, *texts: str) -> dict[str, tuple[str, ...]]:
    return {group.name: group.nodes for group in group_lamps(scene, parse_lamps(texts))}


def test_lights_are_grouped_by_name_without_its_number():
    found = grouped(lit("lamp.001", "lamp.002", "Desk", spots=2))
    assert found == {"lamp": ("lamp.001", "lamp.002"), "Desk": ("Desk",), "Spot": ("Spot.000", "Spot.001")}


def test_names_that_say_nothing_give_way_to_the_material():
    assert list(grouped(lit("Cube.003", "Plane"))) == ["Glow"]


def test_names_fit_into_an_asset():
    # An asset holds names of 256 characters; a longer one would end a bake when its file is written.
    long = "lamp " + "x" * 400
    found = grouped(lit(long + "a", long + "b"), "each")
    assert len(found) == 2 and all(len(name) <= 256 for name in found)
    assert [nodes for nodes in found.values()] == [(long + "a",), (long + "b",)]


def test_emitters_of_a_group_are_its_own():
    scene = lit("a", "b", spots=1)
    groups = group_lamps(scene, parse_lamps(()))
    assert sorted(index for group in groups for index in group.emitters) == [0, 1, 2]
    for group in groups[:2]:
        shape = scene.mi.emitters()[group.emitters[0]].get_shape().id()
        assert scene.meshes[int(shape.removeprefix("mesh_"))].name == group.name


def test_rules_come_first_and_the_rest_is_one_group():
    found = grouped(lit("Desk.L", "Desk.R", "Ceiling"), "desk=desk*")
    assert found == {"desk": ("Desk.L", "Desk.R"), "others": ("Ceiling",)}
    assert len(grouped(lit("Desk.L", "Desk.R", "Ceiling"), "desk=Desk.L", "each")) == 3


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (("x=Nope*",), "lamps: 'x=Nope*' matches no light of scene 'room'; its lights are 'a', 'b'"),
        (("x=a*", "y=a"), "names only lights that a group before it has; give the narrower pattern first"),
        (("desk",), "lamps: 'desk' is not NAME=PATTERN"),
        (("desk=a", "none"), "lamps: none leaves no light a switch, desk has one; leave out none"),
        (("each", "all"), "lamps: each and all group the same lights; give one of them"),
    ],
)
def test_a_wrong_rule_is_one_line_with_the_cure(texts, message):
    with pytest.raises(ValueError, match=r"^lamps: [^\n]+$") as error:
        grouped(lit("a", "b"), *texts)
    assert message in str(error.value)


def test_more_than_64_groups_are_refused_where_they_are_asked_for():
    scene = lit("a", spots=64)
    with pytest.raises(ValueError, match="65 groups of lights, at most 64 can have a switch; join some"):
        grouped(scene, "each")
    assert len(grouped(lit("a", spots=63), "each")) == 64


def test_a_scene_without_light_has_no_lamps():
    dark = assemble("dark", [FLOOR], [GLOW, Material("plain")], digest="dark")
    assert grouped(dark) == {}
    with pytest.raises(ValueError, match="lamps: scene 'dark' has no light of its own; leave out --lamps"):
        grouped(dark, "each")


def test_a_state_is_taken_back():
    scene = lit("a", spots=1)
    groups = group_lamps(scene, parse_lamps(()))
    keys = ("radiance.value", "intensity.value")
    value = lambda k: np.array(mi.traverse(scene.mi.emitters()[groups[k].emitters[0]])[keys[k]]).ravel()  # noqa: E731
    before = [value(0), value(1)]
    with dimmed(scene, groups, {"a": (0.5, 0.25, 0.0)}):
        np.testing.assert_allclose(value(0), before[0] * [0.5, 0.25, 0.0])
        np.testing.assert_allclose(value(1), before[1])
    np.testing.assert_allclose(value(0), before[0])
    with dimmed(scene, groups, {"lamp:a": (0.5, 0.5, 0.5)}):
        np.testing.assert_allclose(value(0), before[0] * 0.5)
    np.testing.assert_allclose(value(0), before[0])
    message = r"set: scene 'room' has no lamp 'b'; .*'a'"
    with pytest.raises(ValueError, match=message), dimmed(scene, groups, {"b": (1,)}):
        pass


def test_the_sky_of_the_model_is_dimmed_too():
    """Mitsuba's ``sunsky`` has no radiance that could be scaled."""
    scene = lit()
    shapes = {f"mesh_{k}": shape for k, shape in enumerate(scene.mi.shapes())}
    scene.mi = mi.load_dict({"type": "scene", **shapes, "sky": {"type": "sunsky"}}, optimize=False)
    groups = group_lamps(scene, parse_lamps(()))
    before = environment_picture(scene, 8)
    assert [group.name for group in groups] == ["environment"] and before.max() > 0
    with dimmed(scene, groups, {"environment": (0.25, 0.25, 0.25)}):
        np.testing.assert_allclose(environment_picture(scene, 8), 0.25 * before, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(environment_picture(scene, 8), before, rtol=1e-5)


def test_the_name_of_a_node_that_is_no_lamp_names_the_way_to_move_it():
    scene = load("doorway")
    message = "has no lamp 'Door'; it is a node, which moves by --set \"node:Door.rotation=45\""
    groups = group_lamps(scene, parse_lamps(()))
    with pytest.raises(ValueError, match=message), dimmed(scene, groups, {"Door": (0, 0, 0)}):
        pass
