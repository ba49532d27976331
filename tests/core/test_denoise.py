"""The denoiser is part of every installation; where it cannot be, a bake says so."""

import builtins
import importlib.util

import numpy as np
import pytest

from lightwell.core import denoise as module
from lightwell.core.denoise import denoise, missing

RNG = np.random.default_rng(5)


def test_the_denoiser_is_installed():
    assert missing() is None


def test_noise_goes_and_the_mean_stays():
    y, x = np.mgrid[:64, :64] / 64
    clean = np.stack([0.2 + 0.3 * x, 0.2 + 0.2 * y, 0.3 + 0 * x], axis=-1)
    noisy = clean * RNG.gamma(8, 1 / 8, (64, 64, 1))
    for filter in ("RT", "RTLightmap"):
        out = denoise(noisy, filter=filter)
        assert np.abs(out - clean).mean() < 0.35 * np.abs(noisy - clean).mean()
        assert abs(out.mean() / clean.mean() - 1) < 0.03


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e6])
def test_the_unit_of_the_picture_does_not_matter(scale):
    noisy = RNG.gamma(4, 0.25, (32, 32, 3)).astype(np.float32)
    assert denoise(scale * noisy) / scale == pytest.approx(denoise(noisy), rel=0.02, abs=0.01)


def test_pixels_without_a_finite_value_keep_theirs_and_none_is_negative():
    noisy = RNG.gamma(4, 0.25, (32, 32, 3))
    out = denoise(noisy, np.full((32, 32, 3), 0.5), np.tile([0.0, 0.0, 1.0], (32, 32, 1)))
    assert out.shape == noisy.shape and out.dtype == np.float32 and (out >= 0).all()


def test_its_absence_is_one_line_with_the_cure(monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **options):
        if name == "mitsuba_oidn":
            raise ImportError(name)
        return real(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ValueError, match=r"^denoise: Open Image Denoise is not installed .*pip install mitsuba-oidn"):
        denoise(np.ones((8, 8, 3)))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert missing() == module.MISSING and "\n" not in module.MISSING
