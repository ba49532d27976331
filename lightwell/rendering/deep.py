"""Deep pictures: several surfaces per pixel, so that a lens can show what its blur uncovers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lightwell.files import whole_file


def write_deep(path: Path, radiance: np.ndarray, depth: np.ndarray) -> None:
    """Write surfaces as the samples of a deep EXR file (R, G, B, A, Z); the file is either complete or absent.

    Args:
        path: File to write, .exr.
        radiance: [K, H, W, 3] radiance of each surface.
        depth: [K, H, W] depth along the camera's axis, metres; infinite where there is no such surface.
    """
    import OpenEXR

    height, width = depth.shape[1:]
    # A picture of the environment alone has a sample, too: the first surface lies at infinity there.
    kept = np.isfinite(depth)
    kept[0] |= radiance[0].any(axis=-1)
    values = {name: radiance[..., k] for k, name in enumerate("RGB")}
    values |= {"A": np.ones_like(depth), "Z": depth}
    planes = {name: np.empty((height, width), object) for name in values}
    for y, x in np.ndindex(height, width):
        here = kept[:, y, x]
        for name, plane in planes.items():
            plane[y, x] = np.ascontiguousarray(values[name][here, y, x], np.float32) if here.any() else None
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    with whole_file(path) as temporary:
        OpenEXR.File(header, planes).write(str(temporary))
