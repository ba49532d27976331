"""A bake of several lights that vary: each has a field of its own, and they are shown and scored together."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.asset.read import read_fields
from lightwell.asset.validate import validate_file
from lightwell.baking.pipeline import bake
from lightwell.baking.preview import Preview
from lightwell.baking.view_setup import FurtherLight, ViewSetup
from lightwell.fields.surface.roles import role_share
from lightwell.scenes import load
from lightwell.scenes.variables import by_light, first_settings
from tests.baking.conftest import small

BOX = "light.position=box(-0.5,1.2,-0.5,0.5,1.6,0.5)"
ARC = "sun.direction=arc(150,20,210,20)"


@pytest.mark.slow
def test_a_lamp_and_a_sun_have_a_field_each(tmp_path):
    vary = (BOX, "light.intensity=3", ARC, "sun.color=1,0.5,0.25")
    report = bake(small(tmp_path / "out", steps=20, views=1, shards=1, vary=vary))
    path = tmp_path / "out/scene.glb"
    fields, variables = read_fields(path)
    assert validate_file(path) == []
    assert [(v["name"], v["kind"]) for v in variables] == [("light", "point"), ("sun", "sun")]
    assert variables[0]["intensity"] == 3 and variables[1]["color"] == [1, 0.5, 0.25] and variables[1]["intensity"] > 0
    own = [(field.name, field.role, field.variable) for field in fields]
    assert own[:2] == [("indirect", "indirect", 0), ("indirect-sun", "indirect", 1)]
    assert report["settings"]["indirect-sun_field"]["relative_error"] > 0
    assert report["settings"]["further_variables"][0]["name"] == "sun"
    assert "sun towards" in (tmp_path / "out/report.html").read_text()


def test_places_and_weights_of_a_view_are_those_of_each_light():
    camera = load("cornell").cameras[0]
    sun = FurtherLight("indirect-sun", None, [np.array([0.0, 1.0, 0.0])], 8.0, (1.0, 1.0, 1.0))
    stage = ViewSetup([(camera, np.ones(3))], 2.0, (1.0, 1.0, 1.0), (sun,))
    assert stage.place("indirect-sun", 0)[1] == 1 and stage.place("indirect", 0).sum() == 3
    # A sun of 8 lux beside a lamp of 2 candela; the scene's own light beside a lamp of 1.
    assert [stage.weight(role) for role in ("indirect", "indirect-sun", "static")] == [1.0, 4.0, 0.5]


def test_declarations_are_sorted_by_light():
    texts = (BOX, "light.radius=0.1", ARC, "node:Door.rotation=y:0..90", "sun.intensity=5")
    assert by_light(texts) == [(BOX, "light.radius=0.1"), (ARC, "sun.intensity=5")]
    with pytest.raises(ValueError, match=r"'snu.intensity=5' is of none of the lights that vary, light, sun; name one"):
        by_light((BOX, ARC, "snu.intensity=5"))
    assert by_light(()) == [()] and first_settings(texts, "light")[0] is None and first_settings(texts, "sun")[0] == 5


def test_the_time_is_shared_among_lights_and_the_scenes_own_light():
    roles = ("indirect", "indirect-sun", "static")
    shares = [role_share(role, roles) for role in roles]
    assert sum(shares) == pytest.approx(1) and shares[0] == shares[1] == pytest.approx(0.35)
    assert role_share("indirect", ("indirect",)) == 1 and role_share("static", ("static",)) == 1
    # Of what is left, the second light and the scene's own share the rest.
    assert role_share("indirect-sun", roles, roles[1:]) == pytest.approx(0.35 / 0.65)


@pytest.mark.parametrize(
    "more, message",
    [
        ({"field": "mlp"}, r"one light can move here, not 2 \(light, sun\); declare one of them"),
        (
            {"vary": tuple(f"l{k}.radius=0.1" for k in range(5))},
            "5 lights, nodes and clips vary, more than the 4 that a page can show; bake fewer of them together",
        ),
        ({"options": {"rebake": "old"}}, "--rebake knows one light; bake whole, or drop sun from --vary"),
        ({"preview": True}, "--preview shows one light; leave it out, or drop a light from --vary"),
    ],
)
def test_what_knows_one_light_says_so(tmp_path, more, message):
    preview = object.__new__(Preview) if more.pop("preview", False) else None
    with pytest.raises(ValueError, match=message):
        bake(small(tmp_path / "out", **({"vary": (BOX, ARC)} | more)), preview=preview)
