"""Ctrl-C is exit code 130 and quiet, from the first line of lightwell that runs."""

import signal
import subprocess
import sys
from threading import Timer

import pytest

QUIET = ("", "lightwell: interrupted")
HELP, SERVER, SCENE = ["--help"], ["view", "{folder}", "--no-open"], ["info", "cornell"]


@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot be sent Ctrl-C alone on Windows")
@pytest.mark.parametrize(
    ("words", "imports"),
    [(HELP, 1), (HELP, 2), (HELP, 8), (SERVER, 20), (SERVER, 80), (SCENE, 40), (SCENE, 120), (SCENE, 220)],
    ids=lambda value: value if isinstance(value, int) else value[0],
)
def test_an_interrupt_after_any_import_is_exit_code_130_and_quiet(tmp_path, words, imports):
    """Moments are counted in imports after that of the package: the first is made when Ctrl-C must be handled."""
    (tmp_path / "index.html").write_text("<html></html>")
    call = "from lightwell.__main__ import main; raise SystemExit(main())"
    process = subprocess.Popen(
        [sys.executable, "-X", "importtime", "-c", call, *(word.format(folder=tmp_path) for word in words)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    limit = Timer(60, process.kill)
    limit.start()
    while (line := process.stderr.readline()) and line.split()[-1] != "lightwell":
        pass
    for _ in range(imports):
        assert process.stderr.readline(), "it ended before so many imports"
    process.send_signal(signal.SIGINT)
    _, err = process.communicate()
    limit.cancel()
    said = "\n".join(line for line in err.splitlines() if not line.startswith("import time:"))
    assert process.returncode == 130 and said in QUIET, (process.returncode, said)


def _run(code: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)


def test_a_second_interrupt_ends_the_process_at_once():
    code = (
        "import signal, time\nfrom lightwell.cli.interrupts import Interrupts\n"
        "with Interrupts():\n"
        "    try: signal.raise_signal(signal.SIGINT)\n"
        "    except KeyboardInterrupt: print('first', flush=True)\n"
        "    signal.raise_signal(signal.SIGINT)\n"
        "    print('still here')"
    )
    found = _run(code)
    assert (found.returncode, found.stdout, found.stderr) == (130, "first\n", "")


def test_an_interrupt_in_a_destructor_is_not_lost():
    code = (
        "import signal\nfrom lightwell.cli.interrupts import Interrupts\n"
        "class Held:\n    def __del__(self): signal.raise_signal(signal.SIGINT)\n"
        "with Interrupts():\n    held = Held()\n    del held\n    print('still here')"
    )
    found = _run(code)
    assert (found.returncode, found.stdout, found.stderr) == (130, "", "")


def test_other_errors_in_destructors_are_printed():
    code = (
        "from lightwell.cli.interrupts import Interrupts\n"
        "class Held:\n    def __del__(self): raise ValueError('from a destructor')\n"
        "with Interrupts():\n    held = Held()\n    del held\n    print('still here')"
    )
    found = _run(code)
    assert (found.returncode, found.stdout) == (0, "still here\n") and "from a destructor" in found.stderr
