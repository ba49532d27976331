"""``lightwell.toml``: precedence, per scene, and mistakes in one line."""

import pytest

from lightwell.cli import bake
from lightwell.cli.configuration import with_configuration
from lightwell.cli.live import bake_words
from lightwell.cli.main import main, verb_parser

FILE = """
[bake]
quality = "best"
seed = 3
vary = ["light.clearance=0.2", "light.radius=0.01"]
static = false
keep = true

[scenes.kitchen]
scene = "kitchen.glb"
field = "lightmap"
size = 512
static = true
budget = "5m"

[render]
light = [0.1, 1.5, -2]
size = "64x40"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lightwell.toml").write_text(FILE)
    (tmp_path / "kitchen.glb").write_bytes(b"")
    return tmp_path


def settings(line):
    words = with_configuration("bake", line.split(), verb_parser)
    return bake.settings(verb_parser("bake", words).parse_args(words))


def test_the_command_line_comes_before_the_scene_and_the_scene_before_the_verb(folder):
    plain = settings("cornell -o x")
    assert (plain.quality, plain.seed, plain.static, plain.keep) == ("best", 3, False, True)
    assert plain.vary == ("light.clearance=0.2", "light.radius=0.01") and plain.field == ""
    kitchen = settings("./kitchen.glb -o x")
    assert (kitchen.field, kitchen.options.size, kitchen.static) == ("lightmap", 512, True)
    assert kitchen.budget.seconds == 300 and kitchen.quality == "best"
    told = settings("kitchen.glb -o x --seed 5 --vary light.radius=0.02 --quality draft")
    assert (told.seed, told.quality, told.vary) == (5, "draft", ("light.radius=0.02",))


def test_another_file_or_none(folder):
    (folder / "other.toml").write_text("[bake]\nseed = 9\n")
    assert settings("cornell -o x --config other.toml").seed == 9
    assert settings("cornell -o x --config none").seed == 0
    (folder / "lightwell.toml").unlink()
    assert settings("cornell -o x --con other.toml").seed == 9, "shortened"


def test_lists_and_other_verbs(folder):
    words = with_configuration("render", ["cornell", "-o", "x.png"], verb_parser)
    assert words[3:] == ["--light", "0.1", "1.5", "-2", "--size=64x40"]
    assert verb_parser("render", words).parse_args(words).size == "64x40"


def test_bakes_of_the_live_page_are_those_of_the_file_but_wait_for_nobody(folder):
    (folder / "lightwell.toml").write_text(
        "[bake]\nwatch = true\npreview = true\nport = 8000\nno-open = true\nquality = 'best'\nresume = true\n"
        "out = 'elsewhere'\nseed = 3\nscene-unit = 'mm'\n"
    )

    def words(line):
        return bake_words(verb_parser("live").parse_args(line.split()))

    assert words("cornell") == ["--seed=3", "--scene-unit=mm", "--config=none"]
    assert words("cornell --scene-unit cm") == ["--scene-unit", "cm", "--seed=3", "--config=none"]
    assert words("cornell --config none") == ["--config=none"]
    made = verb_parser("bake").parse_args(["cornell", "-o", "x", *words("cornell")])
    assert not made.watch and not made.preview


@pytest.mark.parametrize(
    "text, told",
    [
        ("[bake]\nqualty = 1\n", "[bake] there is no option 'qualty'; did you mean 'quality'?"),
        ("[bakee]\nseed = 1\n", "there is no table [bakee]; did you mean 'bake'?"),
        ("seed = 1\n", "there is no table [seed]"),
        ("[bake]\nseed = [1]\n", "option 'seed' of bake is no number or text"),
        ('[bake]\nseed = "three"\n', "option 'seed' of bake is 'three'; write a number"),
        ('[bake]\nkeep = "yes"\n', "is a switch; write true or false"),
        ('[bake]\nquality = "great"\n', "is 'great'; choose one of draft, good, best"),
        ("[bake]\nseed 3\n", "is not TOML"),
        ("[scenes.a]\nseed = 3\n", "[scenes.a] has no scene"),
        ('[scenes.a]\nscene = "cornell"\nsede = 3\n', "[scenes.a] there is no option 'sede'; did you mean 'seed'?"),
        ("[bake]\nconfig = 'x'\n", "there is no option 'config'"),
    ],
)
def test_mistakes_are_one_line(folder, capsys, text, told):
    (folder / "lightwell.toml").write_text(text)
    assert main(["bake", "cornell", "-o", "x"]) == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1 and "lightwell.toml" in error
    assert not (folder / "x").exists()


def test_tables_of_one_scene_are_not_merged(folder, capsys):
    (folder / "lightwell.toml").write_text(
        '[scenes.day]\nscene = "kitchen.glb"\nseed = 1\n[scenes.night]\nscene = "./kitchen.glb"\nsize = 512\n'
        '[scenes.hall]\nscene = "cornell"\nseed = 4\n'
    )
    assert main(["bake", "kitchen.glb", "-o", "x"]) == 2 and not (folder / "x").exists()
    error = capsys.readouterr().err
    assert "lightwell.toml: [scenes.day] and [scenes.night] are both of 'kitchen.glb'" in error
    assert "'lightwell batch lightwell.toml'" in error and error.count("\n") == 1
    assert settings("cornell -o x").seed == 4 and settings("kitchen.glb -o x --config none").seed == 0


def test_a_missing_file_is_named(folder, capsys):
    assert main(["bake", "cornell", "-o", "x", "--config", "no.toml"]) == 2
    assert "there is no file 'no.toml'" in capsys.readouterr().err
