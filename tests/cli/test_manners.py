"""Manners of the command line: suggestions, early errors, help, log, tables."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lightwell.cli import main
from lightwell.cli.info import table
from lightwell.cli.main import COMPUTING, GROUPS, VERBS, verb_parser
from lightwell.cli.next_steps import next_steps
from lightwell.cli.whole_parser import whole_verbs
from lightwell.core.units import size_text, time_text
from lightwell.fields.registry import BUILT_IN, PRESETS, find_field

ROOT = Path(__file__).parents[2]
# CPU time for a mistake, start of Python included, seconds. Wall time would depend on what else runs.
LONGEST = 0.2
MISTAKES = {
    "bakee cornell -o x": "there is no verb 'bakee'; did you mean 'bake'?",
    "bake cornell -o x --bugdet 5m": "there is no option --bugdet; did you mean '--budget'?",
    "bake cornel -o x": "did you mean 'cornell'?",
    "bake ruum.glb -o x": "there is no file 'ruum.glb'; did you mean 'room.glb'?",
    "bake cornell -o x --field mpl": "unknown field 'mpl'; did you mean 'mlp'?",
    "bake cornell -o x --field probes+factored": "the one pair is --field factored+probes",
    "bake cornell -o x --field factored+lightmap": "the one pair is --field factored+probes",
    "bake cornell -o x --field factored+probes --preset tiny": "has no preset 'tiny'; choose one of",
    "bake cornell -o x --field factored --spacing 1m": "is an option of the field 'probes' or 'volume' or",
    "bake cornell -o x --preset larg": "no preset 'larg'; did you mean 'large'?",
    "bake cornell -o x --preset reprot-20": "no preset 'reprot-20'; did you mean 'report-20'?",
    "bake cornell -o x --field mlp --preset larg": "field 'mlp' has no preset 'larg'; did you mean 'large'?",
    "bake cornell -o x --vary light.position=foo": "expected box(x0,y0,z0,x1,y1,z1)",
    "bake cornell -o x --size 256": "--size is an option of the field 'lightmap'",
    "bake cornell -o x --threads 0": "--threads 0 is too small",
    "bake cornell -o x --memory 10MB": "--memory 10MB is too small; give 1GB or more",
    "compare --fields mpl cornell -o x": "unknown field 'mpl'; did you mean 'mlp'?",
    "render cornell -o x.png --aov depth": "--aov is for a single .exr",
    "render cornell -o x.exr --aov depht": "'depht' is unknown; did you mean 'depth'?",
    "render cornell -o x.bmp": "'x.bmp' is neither .png nor .exr",
    "bake cornell --bugdet 5m": "there is no option --bugdet; did you mean '--budget'?",
    "bake cornell -o x --quality god": "--quality 'god' is unknown; did you mean 'good'?",
    "bake cornell -o x --vary light.positon=box(0,0,0,1,1,1)": "did you mean 'position'?",
    "bake cornell -o x --limit cats=3": "--limit 'cats=3' is no limit: write NAME=VALUE with one of",
    "bake cornell -o x --limit vertices": "'vertices' is no limit: write NAME=VALUE with one of",
    "bake cornell -o x --limit vertexes=3": "'vertexes=3' is no limit: did you mean 'vertices'?",
    "bake cornell -o x --vary lamp.positon=box(0,0,0,1,1,1)": "did you mean 'position'? write for example",
    "lens bkae x.lwsp": "unrecognized arguments: x.lwsp",
    "lens bkae": "there is no file 'bkae'; did you mean 'bake'?",
    "store claer": "action 'claer' is unknown; did you mean 'clear'?",
    "info nowhere": "there is no scene of that name",
    "view nowhere": "'nowhere' has no index.html",
    "export nowhere --to glsl": "there is no 'nowhere'",
    "validate nowhere": "there is no 'nowhere'",
    "lens none.exr -o x.exr --focus 1m": "no file none.exr",
    "lens bake": "required: LIBRARY",
    "lens check disc.lwsp --famly depth": "there is no option --famly",
}
PROGRAM = """
import contextlib, io, json, sys, time
from lightwell.cli import main
found = []
for words in json.loads(sys.argv[1]):
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        try:
            code = main(words)
        except SystemExit as ended:
            code = ended.code
    found.append([code, said.getvalue()])
    if len(found) == 1:
        first = time.process_time()
loaded = [m for m in ("mitsuba", "drjit", "numpy") if m in sys.modules]
print(json.dumps({"found": found, "first": first, "loaded": loaded}))
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mistakes")
    (folder / "room.glb").write_bytes(b"")
    argv = [sys.executable, "-c", PROGRAM, json.dumps([words.split() for words in MISTAKES])]
    done = subprocess.run(
        argv, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert [entry.name for entry in folder.iterdir()] == ["room.glb"]
    return json.loads(done.stdout)


def test_mistakes_are_one_line_with_the_cure(told):
    for (words, cure), (code, said) in zip(MISTAKES.items(), told["found"]):
        assert code == 2 and cure in said and len(said.strip().splitlines()) == 1, f"{words}: {code} {said}"


def test_mistakes_are_told_before_anything_slow_is_imported(told):
    # `compare` and `render` parse settings of their own last; none of them needs NumPy either.
    assert told["loaded"] == [] and told["first"] <= LONGEST


def test_presets_in_help_are_those_of_the_fields():
    assert list(PRESETS) == list(BUILT_IN)
    for name, presets in PRESETS.items():
        assert presets == tuple(find_field(name).presets)


def test_lightwell_alone_names_three_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    assert [line.split()[1] for line in lines] == ["demo", "bake", "doctor"]
    (tmp_path / "my room.glb").touch()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/report.json").touch()
    text = next_steps(tmp_path)
    assert "lightwell view out " in text and "lightwell bake 'my room.glb' -o out" in text


def test_every_verb_is_in_one_group_of_the_help(capsys):
    assert sorted(verb for verbs in GROUPS.values() for verb in verbs) == sorted(VERBS)
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out
    assert all(f"\n  {verb} " in text for verb in VERBS) and all(f"{title}:" in text for title in GROUPS)


def test_help_of_bake_is_in_groups_and_names_fields_and_presets():
    text = verb_parser("bake").format_help()
    titles = (
        "what may move:",
        "what learns:",
        "how long, how good:",
        "report:",
        "interrupting:",
        "files from elsewhere:",
    )
    assert all(f"\n{title}\n" in text for title in titles)
    assert all(f"\n  {name} " in text and presets[-1] in text for name, presets in PRESETS.items())


@pytest.mark.parametrize("verb", COMPUTING)
def test_verbs_that_compute_take_options_of_the_machine(verb):
    flags = verb_parser(verb)._option_string_actions
    assert {"--threads", "--memory", "--log"} <= flags.keys()


def test_a_log_says_what_was_done_and_what_went_wrong(tmp_path, capsys):
    log = tmp_path / "log.txt"
    assert main(["info", "cornell", "--log", str(log)]) == 0
    assert main(["bake", "nowhere.glb", "-o", str(tmp_path / "x"), "--log", str(log)]) == 2
    text = log.read_text()
    assert "lightwell info cornell" in text and "ended after" in text
    assert "ERROR" in text and "there is no file 'nowhere.glb'" in text
    assert main(["info", "cornell", "--log", str(tmp_path / "no/log")]) == 2
    assert "--log" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["man"], ["bake", "--help"]])
def test_a_reader_that_has_seen_enough_is_no_error(words):
    argv, environment = [sys.executable, "-m", "lightwell.cli", *words], os.environ | {"PYTHONPATH": str(ROOT)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(argv, env=environment, **pipes) as process:
        process.stdout.close()
        assert (process.stderr.read(), process.wait(60)) == ("", 0)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full disk")
def test_output_that_a_full_disk_does_not_take_is_one_line():
    argv = [sys.executable, "-m", "lightwell.cli", "man"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            argv, env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "the disk is full" in done.stderr


def test_info_is_a_table(capsys):
    assert main(["info", "cornell"]) == 0
    text = capsys.readouterr().out
    assert "bounds            2.026 x 2 x 2.038 m" in text and "{" not in text
    lines = table({"bytes": 291_800, "fields": [{"name": "indirect", "macs": 1199}], "warnings": ["one", "two"]})
    assert lines[0].split() == ["bytes", "292", "kB"] and "  indirect  1,199" in lines and "  two" in lines


def test_info_writes_four_digits_and_no_names_of_python():
    lines = table(
        {"bounds": [[0.0, 0.05094, 0.0], [1.0, 2.0, 1.0]], "fields": [{"macs_per_frame": 50_816, "low": [1 / 3]}]}
    )
    assert lines[0].endswith("from (0, 0.05094, 0) to (1, 2, 1)") and lines[3].split()[:3] == ["macs", "per", "frame"]
    assert lines[4].split() == ["50,816", "(0.3333)"]
    assert table({"clearance": 0.04840012431144715})[0].endswith(" 0.0484")


def test_sizes_and_times_are_written_one_way():
    assert [size_text(n) for n in (0, 950, 291_800, 1_240_000, 2.5e10)] == [
        "0 B",
        "950 B",
        "292 kB",
        "1.24 MB",
        "25 GB",
    ]
    assert [time_text(s) for s in (8.31, 125, 3725)] == ["8.31 s", "2 min 5 s", "1 h 2 min"]


def test_tools_of_the_lens_have_help_of_their_own():
    blur, bake, check = (set(verb_parser("lens", words)._option_string_actions) for words in ((), ["bake"], ["check"]))
    assert {"--focus", "--motion"} <= blur and not {"--focus", "--motion"} & (bake | check)
    assert "--family" in bake - blur - check and "--limit-leak" in check - blur - bake
    assert verb_parser("lens", ["bake"]).format_help().startswith("usage: lightwell lens bake LIBRARY")
    # No settings are read for the tools, and a bake of a library reads no file that a limit could be for.
    assert "--config" in blur and "--config" not in bake | check
    assert "--limit" in blur & check and "--limit" not in bake


def test_settings_for_frames_are_not_those_of_the_tools(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lightwell.toml").write_text("[lens]\nlayers = 4\n")
    with pytest.raises(SystemExit):
        main(["lens", "check"])
    assert "required: LIBRARY" in capsys.readouterr().err


def test_completion_is_a_script_that_bash_reads(capsys):
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    assert "--spacing" in script and "--limit-leak" in script
    assert subprocess.run(["bash", "-n"], input=script, text=True).returncode == 0


def test_completion_of_fish_has_every_verb_and_option(capsys):
    assert main(["completion", "fish"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for verb, *tool in whole_verbs():
        if tool:
            continue
        mine = [line for line in lines if f"_using {verb}'" in line]
        options = {flag for flag in verb_parser(verb, [])._option_string_actions if flag.startswith("--")}
        assert not [flag for flag in options if not any(f" -l {flag[2:]} " in f"{line} " for line in mine)], verb


def test_the_manual_page_has_every_verb_and_option(capsys):
    assert main(["man"]) == 0
    page = capsys.readouterr().out
    assert all(f".SH lightwell {' '.join(words)}\n" in page for words in whole_verbs())
    parsers = [verb_parser(verb, tool) for verb, *tool in whole_verbs()]
    options = {flag for parser in parsers for flag in parser._option_string_actions if flag.startswith("--")}
    assert not [flag for flag in options - {"--help"} if flag.replace("-", r"\-") not in page]
    known = (".TH", ".SH", ".TP", ".B", ".nf", ".fi")
    assert all(line.split(" ")[0] in known for line in page.splitlines() if line.startswith("."))
