"""Files that only native code can read, read in a worker process (``lightwell.core.isolated``) by Mitsuba.

The readers of EXR, HDR and PFM pictures, of serialized meshes and of measured BSDFs are native code that
cannot be trusted with a damaged file. In the worker a crash is one line for the user.
"""

from __future__ import annotations

import os
import struct
import zlib
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.isolated import Arrays

# First two bytes of a serialized mesh; bytes that are unpacked at once.
SERIALIZED, PART = 0x041C, 1 << 20
# Pixel formats that are colours.
COLORS = ("Y", "YA", "RGB", "RGBA", "XYZ", "XYZA")


def answer(request: Arrays) -> Arrays:
    """Read a file.

    Args:
        request: ``path`` of the file and its ``kind``: 'picture', 'serialized' (``index``; written to ``out``, a PLY)
            or 'measured' (``plugin``; only tried); texts and numbers as arrays of shape [].

    Returns:
        For a picture ``pixels`` [height, width, channels] and ``srgb``, whether they are encoded; else nothing.

    Raises:
        ValueError: The kind is unknown.
    """
    mi = _mitsuba()
    kind, path = str(request["kind"]), str(request["path"])
    if kind == "picture":
        return _picture(mi, path)
    if kind == "serialized":
        _check_stream(path, int(request["index"]))
        mesh = mi.load_dict({"type": "serialized", "filename": path, "shape_index": int(request["index"])})
        mesh.write_ply(str(request["out"]))
        return {}
    if kind == "measured":
        mi.load_dict({"type": str(request["plugin"]), "filename": path})
        return {}
    raise ValueError(f"native files: unknown kind '{kind}'")


def _check_stream(path: str, index: int) -> None:
    """Check that the compressed mesh ``index`` of a serialized file is whole; Mitsuba reads on where one ends early."""
    with open(path, "rb") as stream:
        magic, version = struct.unpack("<HH", stream.read(4))
        if magic != SERIALIZED or version not in (3, 4):
            raise ValueError("is no serialized mesh of version 3 or 4")
        if index:
            stream.seek(-4, os.SEEK_END)
            (count,) = struct.unpack("<I", stream.read(4))
            offset = struct.Struct("<Q" if version == 4 else "<I")
            if index >= count:
                raise ValueError(f"has {count} shapes, and shape_index is {index}")
            stream.seek(-4 - offset.size * (count - index), os.SEEK_END)
            stream.seek(offset.unpack(stream.read(offset.size))[0] + 4)
        unpacking = zlib.decompressobj()
        while not unpacking.eof:
            data = unpacking.unconsumed_tail or stream.read(PART)
            if not data:
                raise ValueError("is truncated")
            unpacking.decompress(data, PART)


def _picture(mi: Any, path: str) -> Arrays:
    picture = mi.Bitmap(path)
    name = picture.pixel_format().name
    if name not in COLORS:
        raise ValueError(f"has {picture.channel_count()} channels that are no colours")
    if name.startswith("XYZ"):
        picture = picture.convert(mi.Bitmap.PixelFormat.RGB)
    pixels = np.array(picture)
    return {"pixels": pixels.reshape(*pixels.shape[:2], -1), "srgb": np.array(bool(picture.srgb_gamma()))}


def _mitsuba() -> Any:
    """Mitsuba with its smallest variant: nothing is traced here, and the process must start at once."""
    mitsuba: Any = import_module("mitsuba")
    resolver = mitsuba.file_resolver()
    resolver.clear()
    resolver.append(str(Path(mitsuba.__file__).resolve().parent))
    if mitsuba.variant() is None:
        mitsuba.set_variant("scalar_rgb")
        mitsuba.set_log_level(mitsuba.LogLevel.Error)
        # With one thread, as on a machine of one processor, reading an EXR file does not end: `backend.two_threads`.
        drjit: Any = import_module("drjit")
        drjit.set_thread_count(max(drjit.thread_count(), 2))
    return mitsuba
