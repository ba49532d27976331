"""Damaged files of every format end in one line: nothing crashes, hangs, takes gigabytes or shows a traceback."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from fuzz_formats import FORMATS
from fuzz_run import Tally, Worker, run

# Mutants of each format in a usual run and in a long one.
FEW, MANY = 10, 300


@pytest.fixture(scope="module")
def tallies() -> dict[str, Tally]:
    """All formats, two readers at a time: their processes work, this one waits."""
    readers = dict.fromkeys(one.reader for one in FORMATS.values())
    with ThreadPoolExecutor(2) as pool:
        return {name: tally for found in pool.map(_by_reader, readers) for name, tally in found.items()}


def _by_reader(reader: str) -> dict[str, Tally]:
    """A few mutants of each format that a reader opens, in one process."""
    with Worker(reader) as worker:
        mine = [one for one in FORMATS.values() if one.reader == reader]
        return {one.name: run(one, range(FEW), worker=worker) for one in mine}


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files_end_in_one_line(tallies, name):
    _check(tallies[name], FEW)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_many_damaged_files_end_in_one_line(name):
    _check(run(FORMATS[name], range(MANY), seed=1), MANY)


def _check(tally: Tally, count: int) -> None:
    # A seed that is refused would make a refusal of every mutant.
    assert {seed.kind for seed in tally.seeds} == {"accepted"}, tally.seeds
    assert tally.total == count
    assert not tally.failures, tally.told()
    # Mutations that a reader never notices, or that never get past its first check, test nothing.
    assert tally.counts["refused"] >= 0.1 * count
    assert tally.counts["accepted"] >= 0.02 * count or count < MANY


def test_a_mutant_is_a_function_of_format_seed_and_number():
    for name in ("glb", "xml", "lwsp"):
        first = [FORMATS[name].mutant(3, i).data for i in range(5)]
        assert first == [FORMATS[name].mutant(3, i).data for i in range(5)]
        assert first != [FORMATS[name].mutant(4, i).data for i in range(5)]
