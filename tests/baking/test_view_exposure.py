"""Views are exposed by their own light, within limits."""

from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.baking.quality import MOST_STOPS, least_units, score_picture

SIZE = (24, 16)


def view(level: float, noise: float = 0.0):
    """A picture of one level of indirect light, half as much direct light."""
    pixels = SIZE[0] * SIZE[1]
    halves = [
        level * np.ones((pixels, 3)) + noise * np.random.default_rng(k).standard_normal((pixels, 3)) for k in (1, 2)
    ]
    of_view = SimpleNamespace(half_a=halves[0], half_b=halves[1], seen=np.ones(pixels, bool))
    return SimpleNamespace(view=of_view, direct=0.5 * level * np.ones((pixels, 3)), clean=sum(halves) / 2, size=SIZE)


def scored(picture, least, factor: float):
    """PSNR and FLIP of a field that is wrong by a factor."""
    psnr, flip, _ = score_picture(picture, factor * picture.clean, least)
    return psnr.db, flip


def test_exposure_follows_the_view():
    """The same error at half the light scores the same."""
    pictures = [view(1.0), view(0.5)]
    least = least_units(pictures)
    bright, dim = (scored(picture, least, 1.2) for picture in pictures)
    assert dim == pytest.approx(bright, rel=1e-6)


def test_a_view_that_is_all_but_black_is_not_brought_up_to_middle_grey():
    """Twice its light, 2^-17 of that of the scene, is an error that nobody sees."""
    pictures = [view(1.0), view(2.0**-17)]
    least = least_units(pictures)
    assert least[0] > 2.0 ** -(MOST_STOPS + 2)
    dark, own = scored(pictures[1], least, 2.0), scored(pictures[1], (0.0, 0.0), 2.0)
    assert dark[0] > 50 and dark[1] < 0.02
    assert own[0] < 25 and own[1] > 0.05


def test_black_views_have_no_figures():
    black = view(0.0)
    assert least_units([black]) == (0.0, 0.0) and least_units([]) == (0.0, 0.0)
    assert score_picture(black, np.ones_like(black.clean), (0.1, 0.1)) == (None, None, None)
