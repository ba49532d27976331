"""The script behind ``make test``: it counts what ran, names what failed, and its last line is the total."""

import json
import os
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import run_tests
from run_tests import Counts, Result, Room

ROOT = Path(__file__).parents[1]
JUNIT = """<testsuites><testsuite tests="7" failures="1" errors="1" skipped="2"><testcase classname="tests.a"
name="one"><failure/></testcase><testcase classname="tests.a" name="two"><error/></testcase><testcase
classname="tests.a" name="three"/></testsuite></testsuites>"""
# A process that writes a report of two tests, one of which failed where it ends with exit code 1.
WRITE = """import sys
code = int(sys.argv[1])
print("said by the room")
report = f'<testsuites><testsuite tests="2" failures="{int(code == 1)}"/></testsuites>'
open(sys.argv[2].partition("=")[2], "w").write(report)
sys.exit(code)
"""


def room(name: str, code: int, program: str = WRITE, may_be_empty: bool = False) -> Room:
    """A room that ends with an exit code."""
    command = (sys.executable, "-c", program, str(code))
    return Room(name, command, "--report=", run_tests.read_junit, may_be_empty=may_be_empty)


def test_counts_of_pytest(tmp_path):
    (tmp_path / "report").write_text(JUNIT)
    assert run_tests.read_junit(tmp_path / "report") == Counts(3, 2, 2, ("tests.a::one", "tests.a::two"))


def test_counts_of_vitest(tmp_path):
    """A file that does not load has no tests, and has failed."""
    tests = [{"status": "passed", "fullName": "draws"}, {"status": "failed", "fullName": "lights"}]
    files = [
        {"name": "/web/test/a.test.ts", "status": "failed", "assertionResults": tests},
        {"name": "/web/test/b.test.ts", "status": "failed", "assertionResults": []},
    ]
    numbers = {"numPassedTests": 4, "numFailedTests": 1, "numPendingTests": 2, "numTodoTests": 1}
    (tmp_path / "report").write_text(json.dumps({**numbers, "testResults": files}))
    assert run_tests.read_vitest(tmp_path / "report") == Counts(4, 2, 3, ("a.test.ts > lights", "b.test.ts"))


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_room_runs_and_failures_are_named(jobs, capsys):
    dies = room("dies", 3, "import sys; sys.exit(int(sys.argv[1]))")
    rooms = [room("good", 0), room("bad", 1), dies, room("empty", 5, may_be_empty=True)]
    results = list(run_tests.run(rooms, jobs, {}))
    assert {one.room: (one.failed, one.counts.failed) for one in results} == {
        "good": (False, 0), "bad": (True, 1), "dies": (True, 1), "empty": (False, 0)
    }  # fmt: skip
    text = capsys.readouterr().out
    assert len(re.findall("^said by the room$", text, re.MULTILINE)) == 3
    assert re.search(r"== good: 2 passed.* \d+ s", text)


def test_a_room_that_waits_runs_beside_the_others(tmp_path):
    """It ends when the only other job has run, and that one begins while it is not over."""
    flag = tmp_path / "flag"
    until = f"import pathlib, time\nwhile not pathlib.Path({str(flag)!r}).exists(): time.sleep(0.01)\n" + WRITE
    waits = replace(room("web", 0, until), waits=True)
    rooms = [waits, room("other", 0, f"import pathlib; pathlib.Path({str(flag)!r}).touch()\n" + WRITE)]
    assert {one.room: one.failed for one in run_tests.run(rooms, 1, {})} == {"web": False, "other": False}


def test_time_of_processes_that_are_left_behind_counts():
    """As of a browser, whose processes live on when the one that the tests wait for has ended."""
    work = "import time\nwhile time.process_time() < 0.5: pass"
    leaves = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {work!r}])\n" + WRITE
    (one,) = run_tests.run([room("leaves", 0, leaves)], 1, {})
    assert not one.failed and one.processor_seconds > 0.5


def test_rooms_side_by_side_have_one_thread_each(monkeypatch):
    for name in run_tests.THREADS:
        monkeypatch.delenv(name, raising=False)
    assert {run_tests.environment(True)[name] for name in run_tests.THREADS} == {"1"}
    assert not set(run_tests.THREADS) & set(run_tests.environment(False))
    monkeypatch.setenv("LIGHTWELL_THREADS", "4")
    assert run_tests.environment(True)["LIGHTWELL_THREADS"] == "4"


def test_the_last_line_is_the_total():
    results = [
        Result("a", Counts(3, 0, 1), 0, 2.0, 3.0),
        Result("web", Counts(2, 1, 0, ("a.test.ts > lights",)), 1, 9.0, 4.0),
    ]
    lines = run_tests.summary(results, 10.0).splitlines()
    assert lines[-1] == "5 passed, 1 failed, 1 skipped"
    assert lines[lines.index("FAILED web (exit code 1)") + 1] == "  a.test.ts > lights"
    assert not any("FAILED a" in line for line in lines)
    table = [line.split()[0] for line in lines if line and line.split()[0] in ("a", "web", "all")]
    assert table == ["web", "a", "all"]


def test_an_unknown_room_is_refused(capsys):
    with pytest.raises(SystemExit):
        run_tests.main(["--room", "attic"])
    assert "no room attic" in capsys.readouterr().err


def test_long_rooms_begin_first():
    names = [one.name for one in run_tests.all_rooms("")]
    assert names[: 1 + len(run_tests.LONG)] == ["web", *run_tests.LONG] and len(set(names)) == len(names)


def test_files_and_small_folders_share_a_process():
    """To import Mitsuba takes longer than their tests do."""
    rooms = {one.name: one.command for one in run_tests.python_rooms("")}
    assert {"tests/cli", "tests/compatibility", "tests/test_aov.py"} <= set(rooms["small"])
    assert [name for name in rooms if name.endswith(".py")] == []
    places = [word for command in rooms.values() for word in command if word.startswith("tests/")]
    assert len(set(places)) == len(places)


def test_hypothesis_is_loaded_where_tests_use_it():
    left_out = {one.name for one in run_tests.python_rooms("") if "no:hypothesispytest" in one.command}
    assert {"tests/cache", "small"} <= left_out and not left_out & {"quick", "tests/scenes"}
    assert "no:hypothesispytest" in run_tests.pytest_options(("tests/test_aov.py",))
    assert "no:hypothesispytest" not in run_tests.pytest_options(("tests/graph/test_graph_files.py",))


def test_wrong_types_fail_their_room(tmp_path):
    """mypy writes the report that the script reads."""
    (tmp_path / "wrong.py").write_text("x: int = 'a'\n")
    (tmp_path / "right.py").write_text("x: int = 1\n")
    types = replace(run_tests.types_room(), folder=tmp_path)
    files = {name: replace(types, name=name, command=(*types.command, f"{name}.py")) for name in ("right", "wrong")}
    # One after the other: the second finds what the first knows of the standard library.
    found = {one.room: one for one in run_tests.run(list(files.values()), 1, dict(os.environ))}
    assert found["right"].counts == Counts(1) and not found["right"].failed
    assert found["wrong"].counts.failed == 1 and found["wrong"].failed


def test_make_test_runs_every_file_of_tests():
    places = [ROOT / word for one in run_tests.python_rooms("") for word in one.command if word.startswith("tests/")]
    for path in (ROOT / "tests").rglob("test_*.py"):
        assert any(path.is_relative_to(place) for place in places), path
    fast = re.search(r"^FAST := ((?:.*\\\n)*.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert fast and tuple(fast[1].replace("\\\n", " ").split()) == run_tests.QUICK
    recipe = re.search(r"^test:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert recipe and "tools/run_tests.py" in recipe[1].splitlines()[-1]
