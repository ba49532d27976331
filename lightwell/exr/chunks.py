"""Checks of an EXR file before it is decoded: data windows against limits, chunk sizes against the file's length."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lightwell.exr.header import CHUNK_LINES, MOST_HEADER, PIXEL_BYTES, ExrError, ExrPart, Header, parse_header
from lightwell.limits import LoadBudget

# Bytes of an entry of the chunk offset table, and of the sizes that follow the coordinates of a flat or deep chunk.
OFFSET, FLAT_SIZE, DEEP_SIZES = 8, 4, 24
# Bytes by which a compressed chunk may be longer than a raw one (codecs with a header of their own).
CODEC_OVERHEAD = 1 << 16
# Memory that OpenEXR for Python takes for each pixel of a deep channel beside its samples: an array object, bytes.
DEEP_PIXEL = 120
# A decoded value: float32, bytes.
SAMPLE = 4


def read_header(path: str | Path, budget: LoadBudget) -> tuple[ExrPart, ...]:
    """Read and check the headers of a file and its chunk offset tables.

    A damaged file raises ``ExrError``; an exceeded limit raises the error type of ``budget``.

    Args:
        path: An existing file.
        budget: Charged with file bytes, texels and decoded bytes (float32 channels, deep samples).

    Returns:
        The parts, in the order of the file.
    """
    size = Path(path).stat().st_size
    budget.charge("file_bytes", size)
    with open(path, "rb") as file:
        header = parse_header(file.read(MOST_HEADER), size)
    for part in header.parts:
        _charge(part, budget)
    return _check_chunks(Path(path), header, size, budget)


def _charge(part: ExrPart, budget: LoadBudget) -> None:
    _, _, width, height = part.window
    budget.check_picture(width, height, f"part '{part.name}'" if part.name else "data window")
    budget.charge("decoded_bytes", memory_of(part), "channels")


def memory_of(part: ExrPart) -> int:
    """Compute the memory of a part's decoded channels, with the samples of deep ones once their number is known.

    Args:
        part: A part from ``read_header``.

    Returns:
        Bytes.
    """
    each = DEEP_PIXEL if part.deep else SAMPLE
    return each * part.window[2] * part.window[3] * len(part.channels) + SAMPLE * part.samples


def _check_chunks(path: Path, header: Header, size: int, budget: LoadBudget) -> tuple[ExrPart, ...]:
    """Check the chunk offset tables, which follow the header, of a file of ``size`` bytes; return the parts."""
    parts = []
    at = header.length
    end = at + OFFSET * sum(part.chunks for part in header.parts)
    if end > size:
        raise ExrError("the file ends inside its chunk offset table")
    data = np.memmap(path, np.uint8, "r")
    for number, part in enumerate(header.parts):
        offsets = data[at : at + OFFSET * part.chunks].view("<u8")
        at += OFFSET * part.chunks
        if not offsets.all():
            raise ExrError("it was not written completely")
        lead = 4 * header.multipart
        head = lead + (16 if part.tiles else 4) + (DEEP_SIZES if part.deep else FLAT_SIZE)
        if (offsets < end).any() or (offsets > size - head).any():
            raise ExrError("the file ends early, or its chunk offset table is damaged")
        heads = data[offsets.astype(np.int64)[:, None] + np.arange(head)]
        if header.multipart and (heads[:, :4].copy().view("<i4") != number).any():
            raise ExrError("its chunk offset table is damaged")
        parts.append(_check_lengths(part, heads, size - offsets.astype(np.int64) - head, budget))
    return tuple(parts)


def _check_lengths(part: ExrPart, heads: np.ndarray, left: np.ndarray, budget: LoadBudget) -> ExrPart:
    """Check the chunks' sizes: ``heads`` [C, n] are their first bytes, ``left`` [C] the bytes after these.

    Returns the part, with the number of its deep samples.
    """
    if part.deep:
        table, packed, unpacked = heads[:, -DEEP_SIZES:].copy().view("<u8").T
        # Sizes over the file's length would wrap around in a sum.
        if (table > left).any() or (packed > left).any() or (table + packed > left).any():
            raise ExrError("the file ends early: a chunk reaches past its end")
        # Every channel has the same number of samples, which are decoded as float32.
        deep_pixel = sum(PIXEL_BYTES[channel.pixel_type] for channel in part.channels)
        samples = -(-sum(unpacked.tolist()) // deep_pixel) * len(part.channels)
        budget.charge("decoded_bytes", SAMPLE * samples, "deep samples")
        return replace(part, samples=samples)
    packed = heads[:, -FLAT_SIZE:].copy().view("<i4")[:, 0].astype(np.int64)
    if (packed > left).any():
        raise ExrError("the file ends early: a chunk reaches past its end")
    if (packed <= 0).any() or (packed > _raw_bytes(part) + CODEC_OVERHEAD).any():
        raise ExrError("a chunk has an invalid length")
    return part


def _raw_bytes(part: ExrPart) -> int:
    """Bytes of a whole chunk without compression."""
    pixels = part.tiles.width * part.tiles.height if part.tiles else part.window[2] * CHUNK_LINES[part.compression]
    return pixels * sum(PIXEL_BYTES[channel.pixel_type] for channel in part.channels)
