"""What is traced for a light map, and where more of it."""

import numpy as np

from lightwell.bake.lightmap_trace import narrow
from lightwell.transport.texels import Texels


def test_narrow_places_are_found_in_charts_of_any_outline():
    chart = np.full((64, 64), -1, np.int32)
    chart[2:34, 2:34] = 0
    chart[40:44, 2:60] = 1
    # A comb: a wide back with two thin teeth.
    chart[2:34, 40:56], chart[34:38, 40:42], chart[8:12, 56:63] = 2, 2, 2
    index = np.flatnonzero(chart >= 0)
    found = np.zeros((64, 64), bool)
    found.reshape(-1)[index] = narrow(Texels(index, None, chart))
    assert not found[chart == 0].any() and found[chart == 1].all()
    assert found[8:12, 58:63].all() and not found[10:30, 42:54].any()
    assert not found[chart < 0].any()
