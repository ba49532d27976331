"""Mutations of containers: their parts are changed and put together again, so that checks at the door are passed."""

from __future__ import annotations

import io
import random
import re
import struct
import warnings
import zipfile
import zlib

from fuzz_mutate import INTEGERS, mutate_bytes, mutate_json, mutate_numbers, mutate_text

GLB_MAGIC, JSON_CHUNK = 0x46546C67, 0x4E4F534A
# Bytes that a bomb unpacks to, from a few hundred kilobytes.
BOMB = 1 << 28

# ------------------------------------------------------------------ GLB


def glb_parts(data: bytes) -> tuple[bytes, bytes]:
    """JSON and binary chunk of a whole GLB."""
    length = struct.unpack_from("<I", data, 12)[0]
    return data[20 : 20 + length], data[28 + length :]


def glb_of(text: bytes, binary: bytes) -> bytes:
    """A GLB of two chunks."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", GLB_MAGIC, 2, 12 + len(chunks)) + chunks


def mutate_glb_json(rng: random.Random, data: bytes) -> bytes:
    """The JSON chunk changed, the container whole."""
    text, binary = glb_parts(data)
    return glb_of(mutate_json(rng, text), mutate_bytes(rng, binary) if rng.random() < 0.1 else binary)


def mutate_glb(rng: random.Random, data: bytes) -> bytes:
    """Bytes of the container, of its binary chunk, its headers, its chunks in another order or more of them."""
    text, binary = glb_parts(data)
    act = rng.randrange(5)
    if act == 0:
        return glb_of(text, mutate_bytes(rng, binary) if binary else b"")
    if act == 1:
        out = bytearray(data)
        at = rng.choice((0, 4, 8, 12, 16, 20 + len(text), 24 + len(text)))
        out[at : at + 4] = struct.pack("<I", rng.choice(INTEGERS) % 2**32)
        return bytes(out)
    if act == 2:
        chunks = [data[12 : 20 + len(text)], data[20 + len(text) :]] * rng.choice((1, 2, 50))
        rng.shuffle(chunks)
        body = b"".join(chunks)
        return data[:8] + struct.pack("<I", 12 + len(body)) + body
    return mutate_glb_json(rng, data) if act == 3 else mutate_bytes(rng, data)


# ------------------------------------------------------------------ length-prefixed JSON headers


def mutate_header(rng: random.Random, data: bytes, at: int) -> bytes:
    """A file whose JSON header's length stands at byte ``at``: the header or what follows it changed."""
    length = struct.unpack_from("<I", data, at)[0]
    start, body = at + 4, data[at + 4 + length :]
    act = rng.random()
    if act < 0.25:
        return mutate_bytes(rng, data)
    text = data[start : start + length]
    if act < 0.4:
        body = mutate_bytes(rng, body) if body else body
    else:
        text = mutate_json(rng, text)
    text += b" " * (-(start + len(text)) % 16)
    return data[:at] + struct.pack("<I", len(text)) + text + body


# ------------------------------------------------------------------ arrays

DESCRIPTIONS = ("<f4", "<f8", "<f2", "<i8", "<u8", "|u1", "|b1", "<U7", "|S9", "|O", "<c8", "<M8[s]", ">f4", "|V8",
                "[('a', '<f4')]", "<f16", "x")  # fmt: skip


def mutate_array(rng: random.Random, data: bytes) -> bytes:
    """A .npy file: its description, its shape or its numbers changed, its length right in most."""
    act = rng.random()
    if act < 0.3 or data[:6] != b"\x93NUMPY" or data[6] != 1:
        return mutate_bytes(rng, data)
    length = struct.unpack_from("<H", data, 8)[0]
    text, body = data[10 : 10 + length], data[10 + length :]
    if act < 0.65 and len(body) >= 4:
        body = _numbers(rng, body, text)
    elif act < 0.8:
        text = re.sub(rb"'descr': '[^']*'", f"'descr': {rng.choice(DESCRIPTIONS)!r}".encode(), text)
    elif act < 0.95:
        text = re.sub(rb"\([^)]*\)", _shape(rng, text), text)
    else:
        text = mutate_numbers(rng, text)
    text = text.rstrip() + b" " * 8
    text += b" " * (-(11 + len(text)) % 64) + b"\n"
    return data[:8] + struct.pack("<H", len(text) % 65536) + text + body


def _numbers(rng: random.Random, body: bytes, text: bytes) -> bytes:
    """Values that are not finite, or far away, among the numbers of an array."""
    size = 8 if b"8'" in text else 4
    kind = (
        ("d" if size == 8 else "f")
        if b"f" in text.split(b"fortran")[0].split(b"descr")[-1]
        else ("q" if size == 8 else "i")
    )
    values = (
        (float("nan"), float("inf"), -1e30, 1e38, -1.0, 0.0) if kind in "fd" else (-1, 2**31 - 1, -(2**31), 0, 10**6)
    )
    out = bytearray(body)
    for _ in range(rng.choice((1, 3, 50))):
        if len(out) >= size:
            at = rng.randrange(len(out) // size) * size
            out[at : at + size] = struct.pack("<" + kind, rng.choice(values))
    return bytes(out)


def _shape(rng: random.Random, text: bytes) -> bytes:
    found = re.search(rb"\([^)]*\)", text)
    # A description may have been damaged before.
    old = tuple(map(int, re.findall(rb"\d+", found.group()))) if found else ()
    choices = (
        (),
        (*old, 1),
        old[::-1],
        old[:-1],
        (0, *old[1:]),
        (-1, *old[1:]),
        tuple(n + 1 for n in old),
        (10**9,),
        (2**40, 2**40),
        (1,) * 60,
    )
    return str(rng.choice(choices)).encode()


def members(data: bytes) -> dict[str, bytes]:
    """Names and contents of a zip file."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def archive_of(entries: list[tuple[str, bytes]], packed: bool = False) -> bytes:
    """A zip file of some members; names may come twice."""
    out = io.BytesIO()
    with (
        warnings.catch_warnings(),
        zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED) as archive,
    ):
        warnings.simplefilter("ignore")
        for name, content in entries:
            info = zipfile.ZipInfo(name)
            info.compress_type = archive.compression
            archive.writestr(info, content)
    return out.getvalue()


def _bomb_archive(name: str, entries: list[tuple[str, bytes]]) -> bytes:
    """The archive with one member that unpacks to ``BOMB`` bytes of zeros."""
    text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({BOMB // 4},), }}".encode()
    text += b" " * (-(11 + len(text)) % 64) + b"\n"
    out, block = io.BytesIO(), bytes(1 << 20)
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open(name, "w", force_zip64=True) as stream:
            stream.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text)
            for _ in range(BOMB >> 20):
                stream.write(block)
        for other, content in entries:
            if other != name:
                archive.writestr(other, content)
    return out.getvalue()


# Bombs made so far: making one takes a second.
_bombs: dict[tuple[str, int], bytes] = {}


def mutate_archive(rng: random.Random, data: bytes) -> bytes:
    """An .npz file: members changed, renamed, left out, repeated, or one that unpacks to ``BOMB`` bytes."""
    act = rng.random()
    if act < 0.25:
        return mutate_bytes(rng, data)
    entries = list(members(data).items())
    at = rng.randrange(len(entries))
    name, content = entries[at]
    if act < 0.7:
        for _ in range(rng.choice((1, 1, 3))):
            at = rng.randrange(len(entries))
            entries[at] = (entries[at][0], _member(rng, entries[at][1]))
    elif act < 0.78:
        del entries[at]
    elif act < 0.86:
        entries[at] = (rng.choice((entries[rng.randrange(len(entries))][0], "../x.npy", name[:-4], "")), content)
    elif act < 0.97:
        entries.append((name, _member(rng, content)))
    else:
        key = (name, zlib.crc32(data))
        if key not in _bombs:
            _bombs[key] = _bomb_archive(name, entries)
        return _bombs[key]
    return archive_of(entries, rng.random() < 0.5)


def _member(rng: random.Random, content: bytes) -> bytes:
    """One .npy of an archive; where it holds JSON, its values."""
    head = content[:10]
    length = struct.unpack_from("<H", content, 8)[0] if len(content) > 10 else 0
    body = content[10 + length :]
    if body[:1] == b"{" and rng.random() < 0.8:
        text = mutate_json(rng, body)
        header = re.sub(rb"\([^)]*\)", f"({len(text)},)".encode(), content[10 : 10 + length]).rstrip()
        header += b" " * (-(11 + len(header)) % 64) + b"\n"
        return head[:8] + struct.pack("<H", len(header) % 65536) + header + text
    return mutate_array(rng, content)


# ------------------------------------------------------------------ pictures


def mutate_png(rng: random.Random, data: bytes) -> bytes:
    """A PNG: its chunks changed with the check sums right, or its size a lie."""
    act = rng.random()
    if act < 0.3 or data[:8] != b"\x89PNG\r\n\x1a\n":
        return mutate_bytes(rng, data)
    chunks = _png_chunks(data)
    at = rng.randrange(len(chunks))
    kind, body = chunks[at]
    if act < 0.55:
        size = [rng.choice((0, 1, 7, 5000, 13000, 20000, 65535, 2**31 - 1, 2**32 - 1)) for _ in range(2)]
        rest = chunks[0][1][8:]
        if rng.random() < 0.5:
            rest = bytes([rng.choice((1, 2, 4, 8, 16, 3)), rng.choice((0, 2, 3, 4, 6, 5)), 0, 0, rng.choice((0, 1, 2))])
        chunks[0] = (b"IHDR", struct.pack(">II", *size) + rest)
    elif act < 0.8 and body:
        chunks[at] = (kind, mutate_bytes(rng, body))
    elif act < 0.9:
        chunks[at:at] = [(rng.choice((kind, b"tEXt", b"iCCP", b"zTXt", b"PLTE", b"acTL", b"eXIf")), body)] * rng.choice(
            (1, 3)
        )
    elif act < 0.95:
        del chunks[at]
    else:
        text = b"k\0\0" + zlib.compress(bytes(1 << 26))
        chunks.insert(1, (b"zTXt", text))
    return data[:8] + b"".join(_png_chunk(*chunk) for chunk in chunks)


def _png_chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    chunks, at = [], 8
    while at + 8 <= len(data):
        length = struct.unpack_from(">I", data, at)[0]
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return chunks


def _png_chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def mutate_jpeg(rng: random.Random, data: bytes) -> bytes:
    """A JPEG: its size a lie, or its bytes."""
    at = next((i for i in range(len(data) - 9) if data[i] == 0xFF and data[i + 1] in (0xC0, 0xC2)), -1)
    if at < 0 or rng.random() < 0.6:
        return mutate_bytes(rng, data)
    size = struct.pack(">HH", *(rng.choice((0, 1, 4096, 20000, 65535)) for _ in range(2)))
    return data[: at + 5] + size + data[at + 9 :]


def mutate_hdr(rng: random.Random, data: bytes) -> bytes:
    """A Radiance HDR: its header's text, its size, or its bytes."""
    end = data.find(b"\n", data.find(b"\n\n") + 2) + 1
    if end <= 0 or rng.random() < 0.5:
        return mutate_bytes(rng, data)
    return mutate_text(rng, data[:end]) + data[end:]
