"""The function that the decoding process runs: OpenEXR on a file whose header has been checked."""

from __future__ import annotations

import numpy as np

from lightwell.core.isolated import Arrays

# Threads that decode chunks; each needs part of the limited address space.
THREADS = 4


def decode(request: Arrays) -> Arrays:
    """Decode parts of a file.

    Args:
        request: ``path``, the file; ``parts`` [n] int64, indices of the parts to decode; ``count``, the number of parts
            of the file.

    Returns:
        ``INDEX/flat/CHANNEL`` [height, width] float32 of flat channels; ``INDEX/counts/CHANNEL`` [height, width] int32
        and ``INDEX/samples/CHANNEL`` [n] float32 of deep ones.

    Raises:
        ValueError: OpenEXR cannot read the file, or skips a damaged part.
    """
    import OpenEXR

    found: Arrays = {}
    parts = OpenEXR.File(str(request["path"]), separate_channels=True, num_threads=THREADS).parts
    # OpenEXR skips a part whose pixels it cannot read.
    if len(parts) != int(request["count"]):
        raise ValueError("OpenEXR finds a damaged chunk")
    for index in request["parts"].tolist():
        for name, channel in parts[index].channels.items():
            pixels = channel.pixels
            if pixels.dtype != object:
                found[f"{index}/flat/{name}"] = pixels.astype(np.float32)
                continue
            counts = np.array([0 if p is None else len(p) for p in pixels.ravel()], np.int32)
            samples = [np.ravel(p) for p in pixels.ravel() if p is not None and len(p)]
            found[f"{index}/counts/{name}"] = counts.reshape(pixels.shape)
            found[f"{index}/samples/{name}"] = np.concatenate(samples or [np.zeros(0)]).astype(np.float32)
    return found
