"""Enlarged references keep the edges of surfaces."""

from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.baking.display_pictures import SeenPixels, upsample
from lightwell.baking.reference_budget import PICTURE_SCALE

HEIGHT, WIDTH = 4, 6


def corner(height: int, width: int) -> SimpleNamespace:
    """Two walls that meet in the middle column: the left one faces +x, the right one +z."""
    x = (np.arange(width) + 0.5) / width - 0.5
    y = (np.arange(height) + 0.5) / height
    x, y = (values.ravel() for values in np.meshgrid(x, y))
    left = x < 0
    position = np.where(left[:, None], np.stack([0 * x, y, -x], axis=1), np.stack([x, y, 0 * x], axis=1))
    normal = np.where(left[:, None], [1.0, 0, 0], [0, 0, 1.0])
    return SimpleNamespace(position=position, normal=normal, left=left)


def enlarged(seen: np.ndarray) -> tuple[np.ndarray, SimpleNamespace]:
    """Light 1 on the left wall and 5 on the right one, known at ``seen``, at all pixels of the enlarged picture."""
    low, high = corner(HEIGHT, WIDTH), corner(HEIGHT * PICTURE_SCALE, WIDTH * PICTURE_SCALE)
    light = np.where(low.left, 1.0, 5.0).reshape(HEIGHT, WIDTH, 1) * np.ones(3)
    known = SimpleNamespace(position=low.position[seen], normal=low.normal[seen])
    pixels = np.arange(len(high.left))
    found = upsample(light, SeenPixels(seen, (HEIGHT, WIDTH)), known, high, pixels, np.full(len(pixels), 1 / WIDTH))
    return found, high


def test_light_does_not_cross_an_edge():
    found, high = enlarged(np.arange(HEIGHT * WIDTH))
    assert found[high.left] == pytest.approx(1.0, abs=0.01) and found[~high.left] == pytest.approx(5.0, abs=0.01)


def test_pixels_without_a_surface_have_no_part():
    """The background of the small picture is as dark as it is unknown: it must not darken the wall beside it."""
    all_pixels = np.arange(HEIGHT * WIDTH)
    found, high = enlarged(all_pixels[all_pixels % WIDTH > 0])
    inner = (np.arange(len(high.left)) % (WIDTH * PICTURE_SCALE)) >= PICTURE_SCALE
    assert found[inner & high.left] == pytest.approx(1.0, abs=0.01)
