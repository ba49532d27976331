"""Kernels are compiled once, not once for every number of points: compiling one takes seconds in a furnished room."""

import numpy as np
import pytest

from lightwell.backend import dr
from lightwell.scenes import load
from lightwell.scenes.variables import declare
from lightwell.transport import draw_surface, indirect

# Operations above which a kernel counts as large.
LARGE = 1000


@pytest.fixture
def history():
    """Records the kernels that are launched."""
    before = dr.flag(dr.JitFlag.KernelHistory)
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    dr.kernel_history_clear()
    yield dr.kernel_history
    dr.set_flag(dr.JitFlag.KernelHistory, before)


def test_one_kernel_traces_any_number_of_points(history):
    scene = load("cornell")
    variable = declare((), scene)
    points = draw_surface(scene, 64, 0, floor=1).points
    dr.kernel_history_clear()
    for count in (17, 40, 64):
        indirect(scene, points[np.arange(count)], np.float32([0, 1, 0]), variable, 4, 0)
    traced = {kernel["hash"] for kernel in history() if kernel.get("operation_count", 0) > LARGE}
    assert len(traced) == 1
