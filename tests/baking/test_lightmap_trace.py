"""What is traced for a light map, and where more of it."""

import numpy as np

from lightwell.fields.lightmap.sides import faint_sides
from lightwell.fields.lightmap.trace import narrow
from lightwell.scenes.assemble import assemble
from lightwell.scenes.scene import Material, Mesh
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


def test_a_large_side_that_is_nearly_all_behind_a_block_is_faint():
    """A floor of 4 m², nearly all of one half of which lies under a prism that stands on it."""
    floor = Mesh(
        "floor", np.float32([[0, 0, 0], [0, 0, 2], [2, 0, 2], [2, 0, 0]]), np.uint32([[0, 1, 2], [0, 2, 3]]), 0
    )
    # Prism over the triangle (0, 0), (0, 2), (2, 2): it hides the first triangle of the floor.
    base = np.float32([[-0.02, 0, 0.04], [-0.02, 0, 2.02], [1.96, 0, 2.02]])
    prism = np.concatenate([base - np.float32([0, 0.1, 0]), base + np.float32([0, 0.5, 0])])
    faces = np.uint32([[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]])
    grey = Material("grey", (0.5, 0.5, 0.5, 1), metallic=0.0)
    scene = assemble("block", [floor, Mesh("block", prism, faces, 0)], [grey])
    lit = np.zeros((2, 10), bool)
    lit[0] = True
    faint = faint_sides(scene, lit, 0)
    assert faint[0, 0] and not faint[0, 1] and not faint[1].any()
