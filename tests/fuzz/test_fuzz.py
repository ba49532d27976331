"""Damaged files of every format end in one line: nothing crashes, hangs, takes gigabytes or shows a traceback."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from fuzz_formats import FORMATS
from fuzz_run import Tally, run

# Mutants of each format in a usual run and in a long one.
FEW, MANY = 20, 300


@pytest.fixture(scope="module")
def tallies() -> dict[str, Tally]:
    """All formats, two at a time: their processes work, this one waits."""
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(FORMATS, pool.map(lambda name: run(FORMATS[name], range(FEW)), FORMATS)))


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
