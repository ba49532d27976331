"""Mutations of Mitsuba XML, PLY and OBJ files."""

from __future__ import annotations

import random
import re
import struct

from fuzz_mutate import NUMBERS, mutate_bytes, mutate_text

TAG = re.compile(rb"<[^<>]*>")
VALUE = re.compile(rb'"[^"]*"')
PLUGINS = (
    b"./evil",
    b"../x",
    b"/tmp/evil.so",
    b"",
    b"bitmap",
    b"mask",
    b"envmap",
    b"instance",
    b"shapegroup",
    b"merge",
    b"hair",
    b"serialized",
    b"sdfgrid",
    b"bsplinecurve",
    b"ellipsoids",
    b"principled",
    b"twosided",
    b"blendbsdf",
    b"area",
    b"sphere",
    b"measured",
    b"mesh",
    b"ply",
    b"obj",
    b"rough\xc3\xa9",
    b"scene",
    b"volpath",
    b"hdrfilm",
    b"gridvolume",
    b"irregular",
    b"homogeneous",
    b"bumpmap",
    b"normalmap",
    b"projector",
    b"sunsky",
    b"lightwell_nrc",
)
VALUES = (
    *NUMBERS,
    *PLUGINS,
    b"1, 2",
    b"1 2 3 4 5",
    b"true",
    b"$x",
    b"../room.xml",
    b"room.xml",
    b"/dev/zero",
    b"/etc/passwd",
    b"mesh.ply",
    b"picture.png",
    b"id0",
    b"scene",
    b"&#0;",
    b"x" * 5000,
    b"http://localhost/x",
)
ENTITIES = b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">%s<!ENTITY x SYSTEM "file:///etc/passwd">]>' % b"".join(
    b'<!ENTITY %c "%s">' % (c + 1, b"&%c;" % c * 10) for c in range(97, 107)
)
INSERTS = (
    b'<include filename="room.xml"/>',
    b'<include filename="/dev/zero"/>',
    b'<path value="/"/>',
    b'<alias id="id0" as="id1"/>',
    b'<default name="x" value="$x$x"/>',
    b'<string name="filename" value="/etc/passwd"/>',
    b'<string name="filename" value="picture.png"/>',
    b'<ref id="id0"/>',
    b'<bsdf type="mask"/>',
    b'<bsdf type="twosided"><ref id="id0"/></bsdf>',
    b'<shape type="instance"><ref id="group"/></shape>',
    b'<shape type="shapegroup" id="group"><shape type="sphere"/></shape>',
    b'<float name="alpha" value="nan"/>',
    b'<transform name="to_world"><scale value="0"/></transform>',
    b'<transform name="to_world"><matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 0"/></transform>',
    b"&a;&k;&x;",
    b'<texture type="bitmap" name="reflectance"/>',
    b'<film type="hdrfilm"><integer name="width" value="100000"/><integer name="height" value="100000"/></film>',
    b'<integer name="sample_count" value="4294967295"/>',
    b"<!-- " + b"x" * 9000,
)


def _value(rng: random.Random, data: bytes) -> bytes:
    found = list(VALUE.finditer(data))
    if not found:
        return mutate_bytes(rng, data)
    match = rng.choice(found)
    return data[: match.start()] + b'"' + rng.choice(VALUES) + b'"' + data[match.end() :]


def _swap_values(rng: random.Random, data: bytes) -> bytes:
    found = list(VALUE.finditer(data))
    if len(found) < 2:
        return mutate_bytes(rng, data)
    first, second = rng.choice(found), rng.choice(found)
    return data[: first.start()] + second.group() + data[first.end() :]


def _tag(rng: random.Random, data: bytes) -> bytes:
    found = list(TAG.finditer(data))
    if not found:
        return mutate_bytes(rng, data)
    match = rng.choice(found)
    act = rng.randrange(4)
    if act == 0:
        return data[: match.start()] + data[match.end() :]
    if act == 1:
        return data[: match.start()] + match.group() * rng.choice((2, 3, 300)) + data[match.end() :]
    if act == 2:
        return data[: match.end()] + rng.choice(INSERTS) + data[match.end() :]
    other = rng.choice(found)
    return data[: match.start()] + other.group() + data[match.end() :]


def _nest(rng: random.Random, data: bytes) -> bytes:
    """An element within itself, many times."""
    depth = rng.choice((3, 40, 500, 5000))
    kind, closed = rng.choice(
        ((b'<bsdf type="twosided">', b"</bsdf>"), (b'<shape type="merge">', b"</shape>"), (b"<scene>", b"</scene>"))
    )
    at = data.find(b"</scene>")
    return data[:at] + kind * depth + closed * depth + data[at:]


def _doctype(rng: random.Random, data: bytes) -> bytes:
    return ENTITIES + data.replace(b"</scene>", rng.choice((b"&k;", b"&x;", b"")) + b"</scene>")


def mutate_xml(rng: random.Random, data: bytes) -> bytes:
    """Values, elements, nesting, entities, includes."""
    return mutate_text(rng, data, _value, _value, _value, _swap_values, _tag, _tag, _nest, _doctype)


# ------------------------------------------------------------------ meshes


def _header_line(rng: random.Random, data: bytes) -> bytes:
    kind = rng.choice((b"char", b"uchar", b"short", b"int", b"uint", b"float", b"double", b"int64", b"half"))
    line = rng.choice(
        (
            b"property " + kind + b" extra",
            b"property list " + kind + b" " + rng.choice((kind, b"float")) + b" extra",
            b"element thing " + rng.choice(NUMBERS),
            b"element vertex " + rng.choice(NUMBERS),
            b"element face " + rng.choice(NUMBERS),
            b"format " + rng.choice((b"ascii", b"binary_big_endian", b"binary_little_endian", b"x")) + b" 1.0",
            b"comment " + b"x" * 9000,
            b"end_header",
        )
    )
    lines = data.split(b"\n")
    at = rng.randrange(min(len(lines), 14))
    lines[at : at + rng.randrange(2)] = [line]
    return b"\n".join(lines)


def _index(rng: random.Random, data: bytes) -> bytes:
    """Another number in place of four bytes of a PLY's body."""
    start = data.find(b"end_header\n") + 11
    if start < 11 or len(data) - start < 8:
        return mutate_bytes(rng, data)
    at = start + rng.randrange(len(data) - start - 4)
    value = rng.choice((4, 5, 100, 65536, 2**31 - 1, 2**32 - 1, 0x7FC00000, 0x7F800000))
    return data[:at] + struct.pack("<I", value) + data[at + 4 :]


def mutate_ply(rng: random.Random, data: bytes) -> bytes:
    """The header's lines and numbers; indices and coordinates."""
    end = data.find(b"end_header\n") + 11
    act = rng.random()
    if act < 0.3:
        return _index(rng, data)
    if act < 0.7 and end > 11:
        return mutate_text(rng, data[:end], _header_line) + data[end:]
    return mutate_text(rng, data, _index)


def _corner(rng: random.Random) -> bytes:
    return b"/".join(
        rng.choice((b"1", b"2", b"0", b"-1", b"-9", b"99", b"2147483648", b"")) for _ in range(rng.choice((1, 3)))
    )


def _face(rng: random.Random, data: bytes) -> bytes:
    line = rng.choice((b"f ", b"f ", b"l ", b"p ")) + b" ".join(
        _corner(rng) for _ in range(rng.choice((1, 2, 3, 4, 300)))
    )
    return data + b"\n" + line + b"\n"


def _statement(rng: random.Random, data: bytes) -> bytes:
    return data + rng.choice(
        (
            b"mtllib ../../../etc/passwd\n",
            b"usemtl x\n",
            b"v 1 2\n",
            b"v nan nan nan\n",
            b"vt inf 0\n",
            b"vn 0 0 0\n",
            b"g " + b"x" * 9000,
            b"call /etc/passwd\n",
            b"f\n",
            b"\\\n",
            b"v 1 2 3 4 5 6 7\n",
        )
    )


def mutate_obj(rng: random.Random, data: bytes) -> bytes:
    """Indices, numbers, statements."""
    return mutate_text(rng, data, _face, _statement)
