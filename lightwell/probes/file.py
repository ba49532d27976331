"""Reads and writes probe volumes as files (``format/PROBES.md``).

A line of JSON, then sections: states of nodes, octants, weights, harmonics, cells, fallbacks, bricks, sheets; only
nodes and cells that need a record have one. Readers do not trust the file: sizes, numbers and indices are checked
before use.
"""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.units import size_text
from lightwell.files import write_atomically
from lightwell.limits import Limits
from lightwell.probes import sh
from lightwell.probes.ddgi import Moments
from lightwell.probes.file_baselines import MOMENTS, moment_rows, read_moments
from lightwell.probes.file_tables import (
    BRICK,
    CUT,
    DOUBT,
    KIND,
    SHEET,
    decode_bricks,
    decode_fallbacks,
    decode_kinds,
    decode_sheets,
    encode_bricks,
    encode_fallbacks,
    encode_kinds,
    encode_sheets,
)
from lightwell.probes.file_weights import decode_weights, encode_weights, words_of
from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.volume import DROPPED, LIGHT_BYTES, WEIGHTED, ProbeVolume
from lightwell.probes.weights import FUNCTIONS

MAGIC, VERSION = b"LWPROBES", 4
# Versions that are read. Files of version 3 have no sheets.
READ = (3, 4)
MOST_HEADER, MOST_BYTES = 1 << 16, 1 << 30
# Words of a probe's light by coding. Records of weights: see ``file_weights``; tables: see ``file_tables``.
LIGHT = {coding: size // 4 for coding, size in LIGHT_BYTES.items()}
# Sections start at multiples of this many bytes, the size of a texel.
ALIGN = 16
# Memory per node while a file is read: nine coefficients of three colours and eight fallbacks, four bytes each.
BYTES_PER_NODE = 4 * (9 * 3 + 8)
# Largest stored irradiance, in the file's unit.
BRIGHTEST = 6e4


def write(
    volume: ProbeVolume, path: str | os.PathLike[str], coding: str = "zh3", unit: float = 1.0
) -> dict[str, float]:
    """Write a volume to a file.

    Args:
        volume: The volume.
        path: File to write.
        coding: "l2" (nine harmonics) or "zh3"; band 0 as float16, other bands as bytes with one step per probe.
        unit: Irradiance that is stored as 1; choose it so that stored values are near 1.

    Returns:
        Bytes per live probe, by section.
    """
    data, parts = encode_volume(volume, coding, unit)
    write_atomically(path, data)
    return parts


def encode_volume(
    volume: ProbeVolume, coding: str = "zh3", unit: float = 1.0, baselines: Moments | None = None
) -> tuple[bytes, dict[str, float]]:
    """Encode a volume as the bytes of a file.

    Args:
        volume: The volume.
        coding: "l2" or "zh3", see ``write``.
        unit: Irradiance that is stored as 1.
        baselines: Traced light and distance moments of the same lattice, so that the file can also be evaluated with
            the weights of the baselines; None to leave them out.

    Returns:
        The bytes, and bytes per live probe by section.

    Raises:
        ValueError: The coding is unknown.
    """
    if coding not in LIGHT:
        raise ValueError(f"probes: no coding '{coding}', expected l2 or zh3")
    sections = _sections(volume, coding, unit, baselines)
    places, words = {}, 0
    for name, rows in sections.items():
        places[name] = [words, len(rows)]
        words += -(-rows.nbytes // ALIGN) * (ALIGN // 4)
    lattice = volume.lattice
    header = {
        "version": VERSION,
        "origin": lattice.origin.tolist(),
        "spacing": lattice.spacing,
        "shape": list(lattice.shape),
        "offset": volume.offset,
        "unit": float(unit),
        "coding": coding,
        "function": volume.function,
        "sections": places,
    }
    if baselines is not None:
        header["bias"] = float(baselines.bias)
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-(len(MAGIC) + 4 + len(text)) % 16)
    payload = b"".join(rows.tobytes() + bytes(-rows.nbytes % ALIGN) for rows in sections.values())
    live = max(int(volume.alive.sum()), 1)
    parts = {name: rows.nbytes / live for name, rows in sections.items()}
    return MAGIC + struct.pack("<I", len(text)) + text + payload, parts


def _sections(volume: ProbeVolume, coding: str, unit: float, baselines: Moments | None) -> dict[str, np.ndarray]:
    """Rows of each section, in the order of the file."""
    weighted, cells = volume.row[volume.state == WEIGHTED], encode_fallbacks(volume)
    sections = {
        "kinds": encode_kinds(volume),
        "octants": np.ascontiguousarray(volume.octant[weighted], "<u8").view("<u4").reshape(-1, 2),
        "weights": encode_weights(volume.function, volume.params[weighted]),
        "light": _light(volume.light[volume.alive] / unit, coding),
        "cells": cells[0],
        "fallbacks": cells[1],
        "bricks": encode_bricks(volume),
        "sheets": encode_sheets(volume),
    }
    if baselines is not None:
        sections |= {"traced": _light(baselines.light / unit, coding), "moments": moment_rows(baselines)}
    return sections


def _light(light: np.ndarray, coding: str) -> np.ndarray:
    """[A, 8 or 5] words of A probes: band 0 and the step as four float16, then bytes, ordered by colour."""
    e = np.clip(np.nan_to_num(np.asarray(light, np.float64)), -BRIGHTEST, BRIGHTEST)
    e = sh.windowed(e, sh.deringing(e))
    rest = e[:, 1:] if coding == "l2" else sh.zh3(e)[:, 1:]
    rest = np.swapaxes(rest, 1, 2).reshape(len(e), -1)
    step = (np.abs(rest).max(axis=1, initial=0) / 127).astype(np.float16)
    # Where the step rounds to 0, all bytes are 0.
    code = np.rint(rest / np.where(step > 0, step, 1).astype(np.float64)[:, None]) * (step > 0)[:, None]
    half = np.concatenate([e[:, 0], step[:, None]], axis=1).astype("<f2")
    code = np.clip(code, -127, 127).astype(np.int8)
    return np.concatenate([half.view("<u4"), np.ascontiguousarray(code).view("<u4")], axis=1)


def read(path: str | os.PathLike[str], limits: Limits | None = None) -> ProbeVolume:
    """Read a volume from a file.

    Args:
        path: The file.
        limits: Largest memory that the volume may need; None for the defaults of ``Limits``.

    Returns:
        The volume.

    Raises:
        ValueError: The file is not a probe volume, is damaged or exceeds the limits; one line.
    """
    path = Path(path)
    if path.stat().st_size > MOST_BYTES:
        raise ValueError(f"{path}: larger than {size_text(MOST_BYTES)}, which no probe volume is")
    return decode_volume(path.read_bytes(), str(path), limits)


def decode_volume(data: bytes, name: str = "probes", limits: Limits | None = None) -> ProbeVolume:
    """Decode the bytes of a file.

    Args:
        data: The bytes.
        name: Name of the file, for messages.
        limits: Largest memory that the volume may need; None for the defaults of ``Limits``.

    Returns:
        The volume.

    Raises:
        ValueError: The bytes are not a probe volume, are damaged, exceed the limits or the machine's memory; one line.
    """
    try:
        return _decode_volume(data, name, limits or Limits())
    except MemoryError as error:
        raise ValueError(f"{name}: needs more memory than this machine has; bake fewer probes") from error


def _decode_volume(data: bytes, name: str, limits: Limits) -> ProbeVolume:
    header, words = _parts(data, name)
    lattice, function = _lattice(header, name), header["function"]
    limits.budget(name).charge("decoded_bytes", BYTES_PER_NODE * len(lattice), "its lattice")
    take = lambda section, width, kind="<u4": _section(header, words, section, width, name, kind)  # noqa: E731
    coding = _coding(header, name)
    kinds, octant = take("kinds", 1, "u1")[:, 0], take("octants", 1, "<u8")[:, 0]
    weights, light = take("weights", words_of(function)), take("light", LIGHT[coding])
    older = header["version"] < VERSION
    table = np.pad(take("bricks", BRICK - 1), ((0, 0), (0, 1))) if older else take("bricks", BRICK)
    cells, codes = take("cells", 1, "u1")[:, 0], take("fallbacks", 8, "u1")
    doubt, cut = (cells & DOUBT) > 0, int(((cells & CUT) > 0).sum())
    count, fine = len(lattice), len(kinds) - len(lattice)
    _check(fine >= 0 and (fine > 0) == (len(table) > 0), name, "fine probes where there are bricks")
    _check(bool(((kinds & KIND) <= WEIGHTED).all()), name, "kinds of probes")
    state, row, inner = decode_kinds(kinds)
    _check(len(weights) == len(octant) == int((state == WEIGHTED).sum()), name, "a record of each weighted probe")
    _check(len(light) == int((state != DROPPED).sum()), name, "light of each live probe")
    _check(bool((cells <= DOUBT | CUT).all()), name, "kinds of cells")
    _check(len(cells) == lattice.cell_count and len(codes) == int(doubt.sum()), name, "cells and their fallbacks")
    fallback = decode_fallbacks(lattice, doubt, codes)
    bricks = decode_bricks(lattice, table, inner, cut) if fine else None
    _check(fallback is not None and (not fine or bricks is not None), name, "cells, nodes and fine probes that exist")
    rows = np.zeros((0, SHEET), np.uint16) if older else take("sheets", SHEET, "<u2")
    sheets = decode_sheets(cells, rows, 0 if bricks is None else int((bricks.sheet >= 0).sum()))
    _check(sheets is not None, name, "a finite sheet of each cell that has one")
    values = np.zeros((count + fine, 9, 3), np.float32)
    values[state != DROPPED] = _decoded(light, coding, name) * _number(header, "unit", name)
    return ProbeVolume(
        lattice=lattice,
        function=function,
        state=state,
        row=row,
        params=decode_weights(function, weights, name),
        octant=octant.astype(np.uint64),
        fallback=fallback,
        light=values,
        sheets=sheets,
        offset=_number(header, "offset", name, 0.0, 1.0),
        bricks=bricks,
    )


def read_baselines(path: str | os.PathLike[str]) -> Moments | None:
    """Read the traced light and the distance moments of a file.

    A damaged file is a ``ValueError``, as for ``read``.

    Args:
        path: The file.

    Returns:
        The baselines, or None when the file has none.
    """
    path = Path(path)
    header, words = _parts(path.read_bytes(), str(path))
    sections = header.get("sections")
    if not isinstance(sections, dict) or "moments" not in sections:
        return None
    lattice, coding = _lattice(header, str(path)), _coding(header, str(path))
    rows = _section(header, words, "traced", LIGHT[coding], str(path))
    light = _decoded(rows, coding, str(path)) * _number(header, "unit", str(path))
    moments = _section(header, words, "moments", MOMENTS, str(path))
    bias = _number(header, "bias", str(path), 0.0, 1.0)
    return read_moments(moments, light.astype(np.float32), lattice, bias, str(path))


def _parts(data: bytes, name: str) -> tuple[dict, np.ndarray]:
    """Header and words."""
    start = len(MAGIC) + 4
    if len(data) < start or data[: len(MAGIC)] != MAGIC:
        raise ValueError(f"{name}: not a probe volume (it does not begin with {MAGIC.decode()})")
    size = struct.unpack_from("<I", data, len(MAGIC))[0]
    _check(size <= MOST_HEADER and start + size <= len(data), name, "a header that ends in the file")
    try:
        header = json.loads(data[start : start + size])
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{name}: the header is not JSON") from error
    _check(isinstance(header, dict) and header.get("version") in READ, name, f"version {' or '.join(map(str, READ))}")
    _check(header.get("function") in list(FUNCTIONS), name, f"weights of {', '.join(FUNCTIONS)}")
    rest = data[start + size :]
    _check(len(rest) % 4 == 0, name, "whole words")
    return header, np.frombuffer(rest, "<u4")


def _check(good: bool, name: str, expected: str) -> None:
    if not good:
        raise ValueError(f"{name}: damaged, expected {expected}; bake it again")


def _number(header: dict[str, Any], key: str, name: str, low: float = 1e-30, high: float = 1e30) -> float:
    value = header.get(key)
    good = isinstance(value, (int, float)) and not isinstance(value, bool) and low <= value <= high
    _check(good, name, f"{key} from {low:g} to {high:g}")
    return float(value)


def _coding(header: dict[str, Any], name: str) -> str:
    coding = header.get("coding")
    _check(isinstance(coding, str) and coding in LIGHT, name, f"a coding of {', '.join(LIGHT)}")
    return str(coding)


def _lattice(header: dict[str, Any], name: str) -> ProbeLattice:
    origin, shape = header.get("origin"), header.get("shape")
    good = isinstance(origin, list) and len(origin) == 3 and all(isinstance(v, (int, float)) for v in origin)
    _check(good and all(abs(v) < 1e9 for v in origin), name, "an origin of three numbers")
    good = isinstance(shape, list) and len(shape) == 3 and all(type(v) is int and 2 <= v <= 1 << 16 for v in shape)
    _check(good, name, "a shape of three numbers, 2 or more each")
    return ProbeLattice(np.array(origin), _number(header, "spacing", name, 1e-6, 1e6), tuple(shape))


def _section(
    header: dict[str, Any], words: np.ndarray, section: str, width: int, name: str, kind: str = "<u4"
) -> np.ndarray:
    """[rows, width] numbers of a section."""
    sections = header.get("sections")
    place = sections.get(section) if isinstance(sections, dict) else None
    good = isinstance(place, list) and len(place) == 2 and all(type(v) is int and v >= 0 for v in place)
    size = np.dtype(kind).itemsize * width
    _check(
        good and place[0] % 4 == 0 and 4 * place[0] - (-place[1] * size // ALIGN) * ALIGN <= 4 * len(words),
        name,
        f"section {section} in the file",
    )
    return words.view(np.uint8)[4 * place[0] : 4 * place[0] + place[1] * size].view(kind).reshape(place[1], width)


def _decoded(rows: np.ndarray, coding: str, name: str) -> np.ndarray:
    """[P + F, 9, 3] harmonics of stored light."""
    half = np.ascontiguousarray(rows[:, :2]).view("<f2").astype(np.float64)
    _check(bool(np.isfinite(half).all()), name, "finite light")
    count = 8 if coding == "l2" else 4
    code = np.ascontiguousarray(rows[:, 2:]).view(np.int8).reshape(len(rows), 3, count)
    rest = np.swapaxes(code * half[:, 3, None, None], 1, 2)
    e = np.concatenate([half[:, None, :3], rest], axis=1)
    return e if coding == "l2" else sh.from_zh3(e)
