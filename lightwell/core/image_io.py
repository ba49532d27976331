"""Writes pictures; grey of 16 bits as 8."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from lightwell.core.color import automatic_exposure, picture_bytes
from lightwell.files import write_atomically

# Largest value of 16-bit grey over that of 8-bit grey.
SIXTEEN_OVER_EIGHT = 257


def write_picture(path: Path, picture: np.ndarray, exposure: float | None = None) -> None:
    """Write a picture: linear radiance to .exr, exposed and tone-mapped to other names (.png).

    The file is replaced as a whole: an error leaves no partial file.

    Args:
        path: File to write.
        picture: [H, W, 3] linear radiance.
        exposure: Factor on the radiance for a .png; None for ``automatic_exposure``.
    """
    if path.suffix.lower() == ".exr":
        write_atomically(path, _exr(picture))
        return
    exposed = picture * (automatic_exposure(picture) if exposure is None else exposure)
    write_atomically(path, encoded(picture_bytes(exposed), "PNG"))


def eight_bits(image: Image.Image) -> Image.Image:
    """Scale 16-bit grey to 8 bits, where Pillow's ``convert`` cuts its values at 255, which is almost black.

    Args:
        image: Picture of any mode.

    Returns:
        A picture of mode L for grey of 16 bits; other pictures as they are.
    """
    if image.mode != "I" and not image.mode.startswith("I;16"):
        return image
    grey = np.clip(np.rint(np.asarray(image, np.float64) / SIXTEEN_OVER_EIGHT), 0, 255)
    return Image.fromarray(grey.astype(np.uint8))


def jpeg(pixels: np.ndarray, quality: int) -> bytes:
    """Encode a picture as a JPEG with full colour resolution.

    Args:
        pixels: [H, W, 3] uint8.
        quality: 1 to 100.

    Returns:
        Bytes of the file.
    """
    try:
        return encoded(pixels, "JPEG", quality=quality, subsampling=0, optimize=True)
    except OSError as error:
        if error.errno is not None:
            raise
        # Pillow's buffer for the optimized form is too small for pictures of noise.
        return encoded(pixels, "JPEG", quality=quality, subsampling=0)


def encoded(pixels: np.ndarray, kind: str, **options: int) -> bytes:
    """Encode a picture.

    Args:
        pixels: [H, W, C] uint8.
        kind: 'PNG' or 'JPEG'.
        **options: Options of Pillow's encoder.

    Returns:
        Bytes of the file.
    """
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, kind, **options)
    return stream.getvalue()


def _exr(picture: np.ndarray) -> bytes:
    from lightwell.backend import mi, two_threads

    stream, bitmap = mi.MemoryStream(), mi.Bitmap(np.ascontiguousarray(picture[..., :3], np.float32))
    with two_threads():
        bitmap.write(stream, mi.Bitmap.FileFormat.OpenEXR)
    stream.seek(0)
    return stream.read(stream.size())
