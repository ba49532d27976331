"""Pictures as files."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from lightwell.core.image_io import encoded, jpeg


def test_a_picture_of_noise_is_encoded_too():
    noise = np.random.default_rng(0).integers(0, 256, (720, 1280, 3), dtype=np.uint8)
    with pytest.raises(OSError, match=r"broken data stream|encoder error"):
        encoded(noise, "JPEG", quality=92, subsampling=0, optimize=True)
    found = np.array(Image.open(io.BytesIO(jpeg(noise, 92))))
    assert found.shape == noise.shape and np.abs(found.astype(int) - noise).mean() < 16
