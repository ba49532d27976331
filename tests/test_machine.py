"""Processors and memory of containers, from files as the kernel writes them."""

import subprocess
import sys

import pytest

from lightwell.machine import THREADS_VARIABLE, available_processors, container_memory, threads


def test_a_container_of_version_2_grants_a_share(tmp_path):
    (tmp_path / "cpu.max").write_text("50000 100000\n")
    (tmp_path / "memory.max").write_text("1000000000\n")
    assert available_processors(tmp_path) == 1 and container_memory(tmp_path) == 10**9


def test_a_container_of_version_1_grants_a_share(tmp_path):
    (tmp_path / "cpu").mkdir()
    (tmp_path / "memory").mkdir()
    (tmp_path / "cpu/cpu.cfs_quota_us").write_text("90000\n")
    (tmp_path / "cpu/cpu.cfs_period_us").write_text("100000\n")
    (tmp_path / "memory/memory.limit_in_bytes").write_text("500000000\n")
    assert available_processors(tmp_path) == 1 and container_memory(tmp_path) == 5 * 10**8


def test_without_a_limit_all_is_granted(tmp_path):
    free = available_processors(tmp_path)
    (tmp_path / "cpu.max").write_text("max 100000\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert available_processors(tmp_path) == free >= 1 and container_memory(tmp_path) is None


def test_the_variable_sets_the_threads(monkeypatch):
    monkeypatch.setenv(THREADS_VARIABLE, "3")
    assert threads() == 3
    monkeypatch.setenv(THREADS_VARIABLE, "none")
    with pytest.raises(ValueError, match="LIGHTWELL_THREADS='none' is not a number of threads; give 1 or more"):
        threads()


def test_memory_beyond_the_limit_is_refused():
    pytest.importorskip("resource", reason="there is no such limit on Windows")
    code = "from lightwell.machine import limit_memory; limit_memory(200_000_000); bytearray(400_000_000)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "MemoryError" in done.stderr
