"""Texels that no chart covers."""

import numpy as np

from lightwell.fields.lightmap.atlas_images import dilated


def test_a_texel_between_two_others_is_their_mean():
    image = np.zeros((8, 8, 1), np.float32)
    image[:, :3], image[:, 4:] = 1, 3
    covered = np.ones((8, 8), bool)
    covered[:, 3] = False
    for turned in (lambda a: a, lambda a: np.swapaxes(a, 0, 1)):
        filled = turned(dilated(turned(image), turned(covered), 4))
        assert np.array_equal(filled[:, 3, 0], np.full(8, 2.0))
        assert np.array_equal(filled[:, :3], image[:, :3]) and np.array_equal(filled[:, 4:], image[:, 4:])
