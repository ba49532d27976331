"""The packer of charts: what comes back, what happens when its process dies, and that none is left behind."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from lightwell.scenes.packer import Packer

SQUARE = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.uint32([[0, 1, 2], [0, 2, 3]])


def area(points: np.ndarray, corners: np.ndarray) -> float:
    a, b, c = (points[corners[:, k]].astype(float) for k in range(3))
    return float(np.abs(np.cross(b - a, c - a)).sum() / 2)


def test_charts_are_cut_in_texels_and_packed_apart():
    with Packer() as packer:
        flat, charts = packer.cut([SQUARE] * 5, 20.0)
        packing = packer.pack(flat, 2, True)
    assert charts == 5 and len(flat) == 5 and packing.squares == 1 and packing.charts == 5
    assert [area(*mesh) for mesh in flat] == pytest.approx([400] * 5, rel=0.02)
    middles = np.array([points.mean(axis=0) for points, _ in packing.meshes])
    steps = np.abs(middles[:, None] - middles[None]).max(axis=2)
    assert steps[~np.eye(5, dtype=bool)].min() >= 21.5


def test_hundreds_of_atlases_neither_crash_nor_hang():
    """In one process as the library is meant to be used, one in a few hundred does."""
    with Packer() as packer:
        assert {packer.cut([SQUARE] * 12, 20.0)[1] for _ in range(40)} == {12}


def test_a_process_that_dies_is_replaced_once():
    with Packer() as packer:
        packer.cut([SQUARE], 20.0)
        os.kill(packer.process_id, signal.SIGKILL)
        assert packer.cut([SQUARE], 20.0)[1] == 1


def test_a_mesh_that_kills_the_process_twice_is_one_line():
    broken = SQUARE[0], np.uint32([[0, 1, 9]])
    with Packer() as packer, pytest.raises(ValueError, match=r"^atlas: the packer of charts ended with code [^\n]*$"):
        packer.cut([broken], 20.0)


def test_no_process_is_left_when_ours_is_killed(tmp_path):
    program = (
        "import os, sys; import numpy as np; from lightwell.scenes.packer import Packer\n"
        "corner = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0]]), np.uint32([[0, 1, 2]])\n"
        "p = Packer(); p.cut([corner], 20.0); print(p.process_id, flush=True); os.kill(os.getpid(), 9)\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    pid = int(ended.stdout)
    for _ in range(1000):
        try:
            state = open(f"/proc/{pid}/stat").read().split(") ")[1][:1]
        except (FileNotFoundError, ProcessLookupError):  # no such file; or it ended while it was read
            return
        if state == "Z":
            return
        time.sleep(0.01)
    pytest.fail("the packer outlives its parent")
