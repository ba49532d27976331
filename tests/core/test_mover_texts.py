"""Texts of ``--vary`` and ``--set`` that move a node."""

from __future__ import annotations

import pytest

from lightwell.core.mover_texts import parse_mover, parse_movers
from lightwell.core.vary import parse_vary


def test_a_rotation_has_an_axis_and_two_angles():
    found = parse_mover("node:Front.Door 2.rotation = -y : 0.5..110")
    assert (found.name, found.path, found.values) == ("Front.Door 2", "rotation", (0, -1, 0, 0.5, 110))
    assert parse_mover("node:Lid.rotation=(0,3,4):-20..0").values == (0, 0.6, 0.8, -20, 0)


def test_a_translation_has_two_offsets():
    found = parse_vary("node:Slide.translation=(0,0,0)..(0,0,1.2)")
    assert found.moves and found.learned and found.text == "node:Slide.translation"
    assert found.values == (0, 0, 0, 0, 0, 1.2)


@pytest.mark.parametrize(
    "text, message",
    [
        ("node:Door.rotation=y:5..5", "the range is empty"),
        ("node:Door.translation=(0,0,1)..(0,0,1)", "the range is empty"),
        ("node:Door.rotation=y:0..400", "at most 360 degrees"),
        (
            "node:Door.rotation=0..110",
            r"expected AXIS:FROM..TO in degrees; write for example \"node:Door.rotation=y:0..110\"",
        ),
        ("node:Door.rotation=w:0..110", "expected AXIS:FROM..TO"),
        ("node:Door.rotation=y:0..inf", "expected AXIS:FROM..TO"),
        ("node:Door.translation=0..1", r"expected \(x,y,z\)..\(x,y,z\) in metres"),
        ("node:Door.scale=0..1", "expected node:NAME.rotation=… or node:NAME.translation=…"),
        (
            "animation:Door=0..2",
            r"expected FROM..TO, shares of the clip from 0 to 1; write for example",
        ),
        ("animation:Door=0.5..0.5", "the range is empty"),
        ("animation:=0..1", "expected animation:NAME=…"),
    ],
)
def test_mistakes_are_one_line_with_the_cure(text, message):
    with pytest.raises(ValueError, match=message) as error:
        parse_vary(text)
    assert str(error.value).startswith("vary: ") and "\n" not in str(error.value)


def test_settings_of_a_node_are_set_apart_from_those_of_lamps():
    states, others = parse_movers(["desk=0.3", "node:Door.rotation=45", "day=18:30"])
    assert others == ["desk=0.3", "day=18:30"]
    assert (states[0].name, states[0].axis, states[0].value) == ("Door", None, 45)
    assert parse_movers(["node:Door.rotation=x:-30"])[0][0].axis == (1, 0, 0)
    assert parse_movers(["node:Door.translation=(0,0,0.6)"])[0][0].offset == (0, 0, 0.6)
    two, _ = parse_movers(["node:Door.rotation=45", "animation:Open lid=0.5"])
    assert [(state.name, state.value, state.what) for state in two] == [
        ("Door", 45, "node:Door.rotation"),
        ("Open lid", 0.5, "animation:Open lid"),
    ]


@pytest.mark.parametrize(
    "texts, message",
    [
        (["node:Door.rotation=ajar"], "is no angle in degrees; write for example"),
        (["node:Door.translation=ajar"], "is no offset in metres"),
        (["node:A.rotation=1", "node:A.rotation=2"], "'A' is set twice; leave out one --set 'node:A.rotation=…'"),
        (["animation:Open=50"], 'is no share from 0 to 1; write for example --set "animation:Open=0.5"'),
    ],
)
def test_wrong_settings_are_refused(texts, message):
    with pytest.raises(ValueError, match=message):
        parse_movers(texts)
