"""Mutations of bytes, JSON documents and text, each a function of a random generator and what it changes."""

from __future__ import annotations

import copy
import json
import random
import re
import struct
from collections.abc import Callable
from typing import Any

# Integers at which readers of sizes and indices fail: signs, powers of two, counts that no file holds.
INTEGERS = (-1, 0, 1, 2, 3, 127, 255, 256, 32767, 65535, 65536, 10**5, 10**8, 2**31 - 1, 2**31, 2**32 - 1, 2**53, 2**63,
            2**64, 10**30)  # fmt: skip
FLOATS = (float("nan"), float("inf"), float("-inf"), 1e29, -1e29, 1e38, 3e38, 1e300, 1e-45, -0.0, 0.5, -1.0)
STRINGS = ("", "a", "SCALAR", "VEC3", "MAT4", "NaN", "..", "/dev/zero", "../../../etc/passwd", "a\x00b", "é" * 300,
           "x" * 70_000, "data:,", "file:///dev/zero", "http://localhost/x", "%00", "%2e%2e%2fx")  # fmt: skip
# Values of a document after repetitions: enough for any limit of a tenth, and soon written.
MOST_VALUES = 20_000
# A list of lists, as deep as no document is but no deeper than the writers here can write.
DEPTH = 3000

Mutation = Callable[[random.Random, bytes], bytes]

# ------------------------------------------------------------------ bytes


def _flip(rng: random.Random, data: bytes) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 32))):
        at = rng.randrange(len(out))
        out[at] ^= 1 << rng.randrange(8)
    return bytes(out)


def _bytes_set(rng: random.Random, data: bytes) -> bytes:
    out = bytearray(data)
    out[rng.randrange(len(out))] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))
    return bytes(out)


def _truncate(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data))]


def _cut(rng: random.Random, data: bytes) -> bytes:
    at, length = rng.randrange(len(data)), rng.choice((1, 4, 16, 256))
    return data[:at] + data[at + length :]


def _double(rng: random.Random, data: bytes) -> bytes:
    at, length = rng.randrange(len(data)), rng.choice((1, 4, 16, 256, 4096))
    return data[: at + length] + data[at : at + length] * rng.choice((1, 1, 40)) + data[at + length :]


def _insert(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.randbytes(rng.choice((1, 4, 64))) + data[at:]


def _integer(rng: random.Random, data: bytes) -> bytes:
    """A number in place of 1 to 8 bytes, near the beginning more often, where headers are."""
    size, form = rng.choice(((1, "B"), (2, "H"), (4, "I"), (8, "Q")))
    if len(data) <= size:
        return _flip(rng, data)
    top = min(len(data) - size, 64) if rng.random() < 0.5 else len(data) - size
    at = rng.randrange(top + 1)
    value = rng.choice(INTEGERS) % (1 << 8 * size)
    return data[:at] + struct.pack(rng.choice("<>") + form, value) + data[at + size :]


def _float(rng: random.Random, data: bytes) -> bytes:
    if len(data) < 8:
        return _flip(rng, data)
    at = rng.randrange(len(data) - 3) & ~3
    value = rng.choice(FLOATS)
    return (
        data[:at]
        + struct.pack("<f", value if abs(value) < 3.4e38 or value != value else value / 1e300)[:4]
        + data[at + 4 :]
    )


def _zeros(rng: random.Random, data: bytes) -> bytes:
    at, length = rng.randrange(len(data)), rng.choice((4, 16, 256))
    return data[:at] + rng.choice((b"\0", b"\xff")) * length + data[at + length :]


BYTES: tuple[Mutation, ...] = (
    _flip,
    _flip,
    _bytes_set,
    _truncate,
    _cut,
    _double,
    _insert,
    _integer,
    _integer,
    _float,
    _zeros,
)


def mutate_bytes(rng: random.Random, data: bytes) -> bytes:
    """One to four mutations of a file that is nothing but bytes."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        data = rng.choice(BYTES)(rng, data) if data else b"\0"
    return data


# ------------------------------------------------------------------ JSON


class Raw(str):
    """Text that stands in a JSON document as it is."""


def _nested(depth: int) -> Raw:
    return Raw("[" * depth + "]" * depth)


def _places(document: Any) -> list[tuple[Any, Any]]:
    """(container, key) of every value of a document."""
    found: list[tuple[Any, Any]] = []
    waiting = [document]
    while waiting:
        value = waiting.pop()
        keys = value if isinstance(value, dict) else range(len(value))
        for key in keys:
            found.append((value, key))
            if isinstance(value[key], (dict, list)):
                waiting.append(value[key])
    return found


def _copied(place: tuple[Any, Any]) -> Any:
    """A copy of a value: a document that held it twice, or within itself, would grow without end."""
    return copy.deepcopy(place[0][place[1]])


def _repeated(value: Any, count: int) -> list[Any]:
    """A value so many times, fewer where it is large."""
    size = 1 + (len(_places(value)) if isinstance(value, (dict, list)) else len(str(value)) // 100)
    return [copy.deepcopy(value) for _ in range(max(min(count, MOST_VALUES // size), 1))]


def json_value(rng: random.Random, old: Any, document: Any) -> Any:
    """Something else in place of ``old``: often a number where a number was, else any type."""
    if isinstance(old, (int, float)) and not isinstance(old, bool) and rng.random() < 0.7:
        near = [old + 1, old - 1, -old, old * 2, old * 1000, float(old), old + 0.5]
        return rng.choice([*near, *INTEGERS, *FLOATS])
    kinds = (
        lambda: rng.choice(INTEGERS),
        lambda: rng.choice(FLOATS),
        lambda: rng.choice(STRINGS),
        lambda: rng.choice((None, True, False, [], {}, [[]], [0], {"a": 1}, [None], ["a", "a"])),
        lambda: _repeated(old, rng.choice((2, 3, 100))),
        lambda: {"value": copy.deepcopy(old)},
        lambda: [rng.choice(INTEGERS)] * rng.choice((3, 16, 5000)),
        lambda: _nested(rng.choice((5, 200, DEPTH))),
        lambda: _copied(rng.choice(_places(document))),
    )
    return rng.choice(kinds)()


def _json_step(rng: random.Random, document: Any) -> None:
    places = _places(document)
    if not places or len(places) > MOST_VALUES:
        return
    holder, key = rng.choice(places)
    act = rng.random()
    if act < 0.62:
        holder[key] = json_value(rng, holder[key], document)
    elif act < 0.74:
        del holder[key]
    elif act < 0.84 and isinstance(holder, list):
        holder[key:key] = _repeated(holder[key], rng.choice((1, 1, 30, 400)))
    elif act < 0.92:
        other, at = rng.choice(places)
        if isinstance(other, dict) or at < len(other):
            other[at] = _copied((holder, key))
    elif isinstance(holder, dict):
        name = rng.choice(
            (str(key) + "x", "extras", "extensions", "sparse", "uri", "normalized", "byteStride", "children")
        )
        holder[name] = json_value(rng, holder[key], document)
    else:
        rng.shuffle(holder)


def dump(document: Any) -> str:
    """JSON text with NaN, infinities and ``Raw`` parts."""
    raws: list[str] = []

    def plain(value: Any, depth: int) -> Any:
        if depth > 400:
            return "deep"
        if isinstance(value, Raw):
            raws.append(value)
            return f"@raw{len(raws) - 1}@"
        if isinstance(value, dict):
            return {str(k): plain(v, depth + 1) for k, v in value.items()}
        if isinstance(value, (list, tuple)):
            return [plain(v, depth + 1) for v in value]
        return value

    text = json.dumps(plain(document, 0))
    for number, raw in enumerate(raws):
        text = text.replace(f'"@raw{number}@"', raw)
    return text


def mutate_json(rng: random.Random, text: str | bytes) -> bytes:
    """One to four changes of the values of a JSON document, or of its text."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        # It may have been damaged before.
        return mutate_bytes(rng, text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text)
    for _ in range(rng.choice((1, 1, 2, 4))):
        _json_step(rng, document)
    out = dump(document)[: 1 << 22].encode("utf-8", "surrogatepass")
    act = rng.random()
    if act < 0.04:
        # The same key twice.
        out = out.replace(b'": ', b'": 7, "version": ', 1) if rng.random() < 0.5 else out[:-1] + b"," + out[1:]
    elif act < 0.08:
        out = mutate_bytes(rng, out)
    return out


# ------------------------------------------------------------------ text

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
NUMBERS = (
    b"nan",
    b"inf",
    b"-inf",
    b"1e39",
    b"1e400",
    b"-1",
    b"0",
    b"1",
    b"65536",
    b"100000000",
    b"2147483648",
    b"4294967295",
    b"18446744073709551616",
    b"1e",
    b"--1",
    b"0x10",
    b"1" * 400,
    b"",
)


def mutate_numbers(rng: random.Random, data: bytes) -> bytes:
    """Another number in place of one of a text's."""
    found = list(NUMBER.finditer(data))
    if not found:
        return mutate_bytes(rng, data)
    match = rng.choice(found)
    return data[: match.start()] + rng.choice(NUMBERS) + data[match.end() :]


def mutate_lines(rng: random.Random, data: bytes) -> bytes:
    """Lines left out, repeated, swapped, or without their end."""
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    act = rng.randrange(5)
    if act == 0:
        del lines[at]
    elif act == 1:
        lines[at:at] = [lines[at]] * rng.choice((1, 2, 200))
    elif act == 2:
        other = rng.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    elif act == 3:
        words = lines[at].split()
        rng.shuffle(words)
        lines[at] = b" ".join(words)
    else:
        lines[at] = lines[at] + b" " + b" ".join(lines[at].split()[-1:] * rng.choice((1, 3, 5000)))
    return b"\n".join(lines)


def mutate_text(rng: random.Random, data: bytes, *more: Mutation) -> bytes:
    """One to four changes of a text: its numbers, its lines, its bytes, and what ``more`` does."""
    acts: tuple[Mutation, ...] = (mutate_numbers, mutate_numbers, mutate_lines, mutate_bytes, *more, *more)
    for _ in range(rng.choice((1, 1, 2, 4))):
        data = rng.choice(acts)(rng, data) if data else b"\n"
    return data
