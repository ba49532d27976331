"""What follows from failures: retries elsewhere, workers that are set aside, work that ends the bake."""

import pytest

from lightwell.cluster.ledger import Ledger, UnitFailed


def test_a_worker_that_fails_three_different_units_is_set_aside():
    ledger = Ledger()
    assert [ledger.failed(unit, "a", "broken") for unit in ("u", "u", "v")] == [False] * 3
    assert not ledger.set_aside("a") and ledger.failed("w", "a", "broken")
    assert ledger.set_aside("a") and not ledger.set_aside("b")


def test_a_unit_that_fails_on_three_workers_ends_the_bake_with_its_own_words():
    ledger = Ledger()
    for worker in "ab":
        ledger.failed("u", worker, "NaN")
    assert ledger.avoided("u") == {"a", "b"} and ledger.avoided("v") == set()
    with pytest.raises(UnitFailed, match="failed 3 times on 3 workers: out of textures"):
        ledger.failed("u", "c", "out of textures")


def test_where_there_are_fewer_workers_a_unit_may_fail_three_times():
    ledger = Ledger()
    ledger.failed("u", "a", "NaN")
    ledger.failed("u", "b", "NaN")
    with pytest.raises(UnitFailed, match="3 times on 2 workers"):
        ledger.failed("u", "a", "NaN")


def test_work_of_which_workers_die_ends_the_bake():
    ledger = Ledger()
    ledger.died("u")
    ledger.died("u")
    with pytest.raises(UnitFailed, match="workers die"):
        ledger.died("u")
