"""EXR files of linear numbers, written with OpenEXR: exports need no renderer."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np


def exr_bytes(picture: np.ndarray) -> bytes:
    """Encode numbers as an EXR file.

    Args:
        picture: [H, W, 3] or [H, W, 4] numbers; stored as 32-bit floats, compressed without loss.

    Returns:
        Bytes of the file.
    """
    import OpenEXR

    name = "RGBA"[: picture.shape[2]]
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with tempfile.TemporaryDirectory(prefix="lightwell-") as folder:
        path = Path(folder) / "picture.exr"
        OpenEXR.File(header, {name: np.ascontiguousarray(picture, np.float32)}).write(str(path))
        return path.read_bytes()
