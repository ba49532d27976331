"""The light map that engines are given: diffuse light alone, of all fields, in linear numbers."""

from pathlib import Path

import numpy as np
import pytest

from lightwell.asset.records import FieldEntry
from lightwell.cli import main
from lightwell.engines.bake import Bake, lit_nodes, read_bake
from lightwell.engines.bevy import files as bevy_files
from lightwell.engines.light_map import light_map
from lightwell.engines.text import identifier, quoted
from lightwell.engines.web import babylon_files
from lightwell.graph import Buffer, Builder


def graph(light: np.ndarray, gloss: int, follows: bool = False):
    """A light map of FORMAT: lit (a E' (1 + g e) + g e) / reflectance, with a constant e for what the eye sees."""
    b = Builder(uv1=2, reflectance=3, metallic=1, **({"light": 3} if follows else {}))
    stored = b.texture("uv1", b.buffer(Buffer(light.astype(np.uint8), "uint8", np.float32(1 / 255)), "e"))
    if follows:
        stored = b.multiply(stored, b.slice("light", 1, 1))
    mask = np.zeros((2, 2, 3), np.uint8)
    mask[..., 0], mask[..., 1] = gloss, 255
    m = b.texture("uv1", b.buffer(Buffer(mask, "uint8", np.float32(1 / 255)), "m"))
    albedo = b.affine("reflectance", [1] * 3, [-0.04] * 3)
    seen = b.scale(b.slice(m, 0, 1), 2.718)
    radiance = b.add(b.multiply(b.multiply(albedo, stored), b.affine(seen, [1], [1])), seen)
    return b.build(radiance=b.multiply(b.multiply(radiance, b.slice(m, 1, 1)), b.reciprocal("reflectance", 1e-9)))


@pytest.mark.parametrize("gloss", [0, 255])
def test_the_light_map_is_the_diffuse_light_whatever_the_gloss(gloss):
    stored = np.arange(4 * 8 * 3).reshape(4, 8, 3)
    found = light_map([FieldEntry("map", "static", graph(stored, gloss))], [])
    np.testing.assert_allclose(found, stored / 255, atol=1e-6)


def test_the_light_of_a_variable_is_that_of_its_first_value_and_adds_to_the_rest():
    stored = np.full((4, 4, 3), 51)
    variable = {"initial": [0.0, 2.0, 0.0], "intensity": 3.0, "color": [1.0, 0.5, 0.0]}
    fields = [
        FieldEntry("map", "static", graph(stored, 0)),
        FieldEntry("lamp", "indirect", graph(stored, 0, True), 0),
    ]
    np.testing.assert_allclose(
        light_map(fields, [variable])[0, 0], 0.2 + 0.2 * 2 * 3 * np.array([1, 0.5, 0]), atol=1e-6
    )


def test_a_field_without_light_map_coordinates_has_none():
    b = Builder(position=3)
    assert light_map([FieldEntry("a", "static", b.build(radiance=b.scale("position", 1.0)))], []) is None


def test_lit_nodes_are_those_with_a_second_set_of_coordinates(bake_folder):
    assert read_bake(bake_folder).lit == ("floor", "wall")
    document = {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}, {}]}
    assert lit_nodes(document) == ()


def test_names_are_safe_in_the_texts_of_engines():
    assert identifier('a"); drop() 2') == "a_drop_2" and identifier("2 é") == "field_2"
    assert quoted('a"\n\\ü') == '"a\\"_\\\\ü"'
    # No line ends, nothing that turns the direction of text, no halves of surrogate pairs.
    assert quoted("a\u2028b\u202ec\ud800") == '"a_b_c_"'


def test_the_command_writes_a_folder_and_names_its_files(bake_folder, tmp_path, capsys):
    assert main(["export", str(bake_folder), "--to", "threejs", "-o", str(tmp_path / "out")]) == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"scene.glb", "lightwell.js", "light_map.bin", "probes.bin"}
    assert capsys.readouterr().out.count("\n") == len(names)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--to", "godot", "--weights", "table"], "--weights is for languages"),
        (["--to", "source"], "found 'source'; choose one of them"),
        (["--to", "gdot"], "found 'gdot'; did you mean 'godot'?"),
    ],
)
def test_mistakes_are_one_line(bake_folder, arguments, message, capsys):
    assert main(["export", str(bake_folder), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


def test_a_bake_without_light_for_an_engine_is_refused():
    bake = Bake(Path("room.glb"), (), None, (), None)
    with pytest.raises(ValueError, match=r"has no light map; bake with --field lightmap$"):
        babylon_files(bake, None)
    with pytest.raises(
        ValueError, match="neither a light map nor probes; bake with --field lightmap or --field probes"
    ):
        bevy_files(bake, None)
