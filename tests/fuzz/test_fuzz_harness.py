"""The harness itself: planted readers, one for every outcome, and whether it tells them apart."""

import pytest
from fuzz_formats import Format
from fuzz_run import Worker, run, write_case
from fuzz_seeds import single

PLANTED = {
    "A": "accepted",
    "R": "refused",
    "N": "message",
    "L": "message",
    "K": "traceback",
    "S": "crash",
    "E": "crash",
    "H": "hang",
    "B": "hang",
    "M": "memory",
    "P": "memory",
    "W": "accepted",
    "F": "silent",
    "G": "silent",
}


@pytest.fixture(scope="module")
def worker():
    with Worker("planted", seconds=1.0, memory=1 << 27) as worker:
        yield worker


@pytest.mark.parametrize("letter", PLANTED)
def test_planted_readers_are_told_apart(worker, tmp_path, letter):
    outcome = worker.open(write_case(single("planted.bin", letter.encode()), tmp_path))
    assert outcome.kind == PLANTED[letter], outcome
    # The next file is opened as if nothing had happened.
    assert worker.open(write_case(single("sound.bin", b"A"), tmp_path)).kind == "accepted"


def test_a_traceback_says_where(worker, tmp_path):
    outcome = worker.open(write_case(single("planted.bin", b"K"), tmp_path))
    assert "KeyError" in outcome.detail and "fuzz_readers.py" in outcome.detail


def test_a_planted_bug_fails_a_run(tmp_path):
    """A format whose reader has a bug: the run that ``test_fuzz`` asserts on counts it and keeps the files."""
    seeds = [single("planted.bin", b"A")]
    broken = Format("broken", lambda: seeds, lambda rng, case: rng.choice((b"A", b"R", b"K")), "planted")
    tally = run(broken, range(12), keep=tmp_path)
    assert tally.seeds[0].kind == "accepted" and tally.total == 12
    assert tally.failures and {o.kind for _, o in tally.failures} == {"traceback"} and "KeyError" in tally.told()
    assert len(list((tmp_path / "broken").iterdir())) == tally.counts["traceback"]
