"""Writing pictures."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from lightwell.core.color import automatic_exposure, picture_bytes
from lightwell.files import write_atomically


def check_picture_name(path: Path, verb: str) -> None:
    """Refuse a name that is neither .png nor .exr."""
    if path.suffix.lower() not in (".png", ".exr"):
        raise ValueError(f"{verb}: '{path}' is neither .png nor .exr; choose one of them")


def write_picture(path: Path, picture: np.ndarray, exposure: float | None = None) -> None:
    """Write linear radiance [H, W, 3] as it is (.exr), or exposed and tone-mapped (.png); whole or not at all.

    ``exposure`` multiplies it for a .png; None: ``automatic_exposure``.
    """
    if path.suffix.lower() == ".exr":
        write_atomically(path, _exr(picture))
        return
    exposed = picture * (automatic_exposure(picture) if exposure is None else exposure)
    write_atomically(path, encoded(picture_bytes(exposed), "PNG"))


def encoded(pixels: np.ndarray, kind: str, **options: int) -> bytes:
    """Encode [H, W, C] uint8 as 'PNG' or 'JPEG'."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, kind, **options)
    return stream.getvalue()


def _exr(picture: np.ndarray) -> bytes:
    from lightwell.backend import mi

    stream = mi.MemoryStream()
    mi.Bitmap(np.ascontiguousarray(picture[..., :3], np.float32)).write(stream, mi.Bitmap.FileFormat.OpenEXR)
    stream.seek(0)
    return stream.read(stream.size())
