"""Decode the pixels of an EXR file with OpenEXR in a separate process."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightwell.core.isolated import Arrays, Worker, WorkerDied, WorkerError
from lightwell.exr.chunks import memory_of
from lightwell.exr.header import ExrError, ExrPart

# Most copies of the pixels that decoding holds: OpenEXR's planes, float32 arrays, compression buffers.
COPIES = 4
# Bytes of the answer beside its pixels: counts of deep samples, names.
OVERHEAD = 1 << 24


@dataclass(frozen=True)
class DecodedPart:
    """The pixels of one part."""

    header: ExrPart
    flat: Arrays
    """Channel name to [height, width] float32; channels that are not sampled at every pixel are left out."""
    deep: dict[str, tuple[np.ndarray, np.ndarray]]
    """Channel name to the number of samples of each pixel [height, width] and all samples in their order, float32."""


def decode_parts(
    path: str | Path, parts: Sequence[ExrPart], wanted: Sequence[int], seconds: float
) -> list[DecodedPart]:
    """Decode parts of a file whose header has been checked.

    Args:
        path: The file.
        parts: All its parts, from ``read_header``.
        wanted: Indices of the parts to return.
        seconds: Time limit, > 0.

    Returns:
        The wanted parts, in the order of ``wanted``.

    Raises:
        ExrError: The pixels are damaged, or the package OpenEXR is missing.
    """
    if importlib.util.find_spec("OpenEXR") is None:
        raise ExrError("the package OpenEXR is missing; run: pip install OpenEXR")
    size = sum(memory_of(part) for part in parts) + OVERHEAD
    request = {
        "path": np.array(str(Path(path).absolute())),
        "parts": np.array(wanted, np.int64),
        "count": np.array(len(parts)),
    }
    try:
        with Worker("lightwell.exr.worker:decode", seconds=seconds, memory=COPIES * size) as worker:
            answer = worker.ask(request, 2 * size)
    except (WorkerDied, WorkerError) as error:
        raise ExrError(f"decoding its pixels failed: {error}") from None
    return [_decoded(index, parts[index], answer) for index in wanted]


def _decoded(index: int, part: ExrPart, answer: Arrays) -> DecodedPart:
    """Return one part of the worker's answer; raise ``ExrError`` where a channel is missing or has another shape."""
    _, _, width, height = part.window
    flat, deep = {}, {}
    for channel in part.channels:
        if channel.sampling != (1, 1):
            continue
        keys = [f"{index}/{kind}/{channel.name}" for kind in (("counts", "samples") if part.deep else ("flat",))]
        found = [answer[key] for key in keys if key in answer]
        if len(found) < len(keys) or found[0].shape != (height, width):
            raise ExrError(f"channel '{channel.name}' cannot be decoded")
        if part.deep:
            deep[channel.name] = found[0], found[1]
        else:
            flat[channel.name] = found[0]
    return DecodedPart(part, flat, deep)
