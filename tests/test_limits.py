"""Limits: parsed, summed over a document, and told in one line."""

import dataclasses

import pytest

from lightwell.limits import NAMES, Limits, LoadBudget


def test_parse_changes_what_is_named_and_keeps_the_rest():
    limits = Limits.parse(["vertices=5e7", "seconds=1.5"])
    assert limits == dataclasses.replace(Limits(), vertices=50_000_000, seconds=1.5)
    assert type(limits.vertices) is int


@pytest.mark.parametrize("text", ["vertices", "vertices=", "vertices=-1", "vertices=inf", "vertices=nan", "cats=3", ""])
def test_parse_refuses_what_is_no_limit(text):
    with pytest.raises(ValueError, match="limit: "):
        Limits.parse([text])


@pytest.mark.parametrize("value", [0, -1, float("nan"), "3", True])
def test_a_limit_is_a_number_above_zero(value):
    with pytest.raises(ValueError, match="expected a number above 0"):
        Limits(vertices=value)


def test_charges_add_up_and_the_breach_names_file_thing_limit_and_cure():
    budget = Limits(vertices=1000).budget("scene 'a.glb'")
    budget.charge("vertices", 600, "mesh 0")
    budget.check("vertices", 1000)
    with pytest.raises(ValueError) as caught:
        budget.charge("vertices", 401, "mesh 1")
    message = str(caught.value)
    assert message.startswith("scene 'a.glb': mesh 1: 1001 vertices, more than the limit of 1000; ")
    # The value in the message is one that would do.
    name, _, value = message.rpartition("--limit ")[2].partition("=")
    assert getattr(Limits.parse([f"{name}={value}"]), name) >= 1001
    assert "\n" not in message


def test_pictures_are_checked_alone_and_summed():
    budget = Limits().budget("scene 'a.glb'")
    for i in range(64):
        budget.check_picture(4096, 4096, f"image {i}")
    with pytest.raises(ValueError, match="texels in one picture"):
        budget.check_picture(13_000, 13_000, "image 64")
    with pytest.raises(ValueError, match="texels along an edge"):
        budget.check_picture(16_385, 1, "image 65")
    with pytest.raises(ValueError, match=r"--limit texels=1\.3e"):
        budget.check_picture(16_384, 8_192, "image 66")


def test_time_is_a_limit():
    Limits().budget("x").check_time()
    with pytest.raises(ValueError, match="seconds"):
        Limits(seconds=1e-9).budget("x").check_time()


def test_a_breach_raises_what_the_reader_chose():
    class ReaderError(ValueError):
        pass

    with pytest.raises(ReaderError):
        LoadBudget(Limits(nodes=1), "x", ReaderError).charge("nodes", 2)


def test_every_limit_is_documented():
    assert set(NAMES) == {field.name for field in dataclasses.fields(Limits)}
    source = __import__("inspect").getsource(Limits)
    assert source.count('"""') == 2 * (len(NAMES) + 3)
