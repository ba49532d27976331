"""EXR files: every kind is read, every damage is one line, nothing is allocated beyond the limits."""

import itertools
import struct

import numpy as np
import OpenEXR
import pytest

from lightwell.core.isolated import Worker, WorkerError
from lightwell.exr import ExrError, decode_parts, read_header
from lightwell.exr.header import parse_header
from lightwell.exr.worker import decode
from lightwell.lens import exr, frames
from lightwell.lens.errors import LensError
from lightwell.limits import Limits

H, W = 21, 37
LIMITS = Limits(decoded_bytes=1 << 24, picture_texels=1 << 20)
COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")


def _tiles(size=16):
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = size
    tiles.mode = OpenEXR.ONE_LEVEL
    return tiles


def _planes(kind=np.float16, names="RGBAZ"):
    rng = np.random.default_rng(7)
    return {name: (rng.random((H, W)) * 9 + 1).astype(kind) for name in names}


def _flat(path, compression="ZIP", kind=np.float16, tiled=False, **more):
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), **more}
    header |= {"type": OpenEXR.tiledimage, "tiles": _tiles()} if tiled else {"type": OpenEXR.scanlineimage}
    OpenEXR.File(header, _planes(kind)).write(str(path))
    return path


def _parts(path):
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage, "name": name}, _planes(np.float32, channels), name)
        for name, channels in (("picture", "RGBA"), ("depth", "Z"))
    ]
    OpenEXR.File(parts).write(str(path))
    return path


def _deep(path):
    rng = np.random.default_rng(3)
    counts = rng.integers(0, 4, (H, W))
    channels = {name: np.empty((H, W), object) for name in "RGBAZ"}
    for y, x in itertools.product(range(H), range(W)):
        for plane in channels.values():
            plane[y, x] = (rng.random(counts[y, x]) + 0.1).astype(np.float32) if counts[y, x] else None
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    OpenEXR.File(header, dict(channels)).write(str(path))
    return path, counts, channels


SEEDS = {
    "scan lines": _flat,
    "tiles": lambda path: _flat(path, "PIZ", np.float32, tiled=True),
    "uint": lambda path: _flat(path, "RLE", np.uint32),
    "parts": _parts,
    "deep": lambda path: _deep(path)[0],
}


@pytest.fixture(scope="module")
def worker():
    with Worker("lightwell.exr.worker:decode", seconds=20, memory=1 << 28) as started:
        yield started


def _read(path, worker, limits=LIMITS):
    parts = read_header(path, limits.budget("x"))
    numbers = np.arange(len(parts))
    return worker.ask({"path": np.array(str(path)), "parts": numbers, "count": np.array(len(parts))}, 1 << 28)


@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_every_compression_is_read(tmp_path, compression, tiled):
    for kind in (np.float16, np.float32, np.uint32):
        path = _flat(tmp_path / "a.exr", compression, kind, tiled)
        read_header(path, LIMITS.budget("x"))
        found = decode({"path": np.array(str(path)), "parts": np.array([0]), "count": np.array(1)})
        lossy = compression in ("PXR24", "B44", "B44A", "DWAA", "DWAB")
        for name, plane in _planes(kind).items():
            assert np.allclose(found[f"0/flat/{name}"], plane, rtol=0.2 if lossy else 0)


def test_parts_and_deep_samples_come_back(tmp_path):
    found = exr.read(_parts(tmp_path / "p.exr"))
    assert list(found.names) == ["A", "B", "G", "R", "depth.Z"]
    assert np.array_equal(found.names["depth.Z"], _planes(np.float32, "Z")["Z"])
    path, counts, channels = _deep(tmp_path / "d.exr")
    deep = exr.read(path).deep
    assert np.array_equal(deep["Z"][0], counts)
    assert np.array_equal(deep["G"][1], np.concatenate([p for p in channels["G"].ravel() if p is not None]))


def test_a_pixel_may_have_very_many_deep_samples(tmp_path):
    count = 2_000_000
    channels = {name: np.empty((1, 1), object) for name in "RGBAZ"}
    for plane in channels.values():
        plane[0, 0] = np.ones(count, np.float32)
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    OpenEXR.File(header, channels).write(str(tmp_path / "d.exr"))
    counts, samples = exr.read(tmp_path / "d.exr").deep["Z"]
    assert counts[0, 0] == len(samples) == count
    with pytest.raises(LensError, match="deep samples"):
        exr.read(tmp_path / "d.exr", limits=Limits(decoded_bytes=1 << 24))


def test_options_for_channels_are_refused_for_deep_files(tmp_path):
    path, _, _ = _deep(tmp_path / "d.exr")
    for option in ({"depth_channel": "Z"}, {"motion_channels": "u,v"}, {"depth_file": path}):
        with pytest.raises(LensError, match="is deep: its depth is the channel Z"):
            frames.read(path, **option)


@pytest.mark.parametrize("seed", SEEDS)
def test_every_truncated_file_is_refused(tmp_path, seed):
    data = SEEDS[seed](tmp_path / "a.exr").read_bytes()
    path = tmp_path / "cut.exr"
    for length in {*range(0, len(data), max(len(data) // 60, 1)), len(data) - 1}:
        path.write_bytes(data[:length])
        with pytest.raises(ExrError):
            read_header(path, LIMITS.budget("x"))


def test_a_truncated_file_is_one_line_that_names_it(tmp_path):
    path = _flat(tmp_path / "frame.exr")
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(
        LensError, match=r"^lens: cannot read .*frame\.exr as EXR \(the file ends early.*export it again$"
    ):
        exr.read(path)


def test_damaged_pixels_are_one_line(tmp_path, worker):
    path = _flat(tmp_path / "a.exr")
    data = path.read_bytes()
    path.write_bytes(data[:-200] + bytes(200))
    with pytest.raises(WorkerError, match="damaged"):
        _read(path, worker)
    with pytest.raises(ExrError, match="decoding its pixels failed"):
        decode_parts(path, read_header(path, LIMITS.budget("x")), [0], 20)


def _altered(path, before: bytes, after: bytes):
    data = path.read_bytes()
    assert data.count(before) == 1
    path.write_bytes(data.replace(before, after))
    return path


@pytest.mark.parametrize(
    ("what", "text"),
    [
        ((1 << 20, 1 << 20), "texels along an edge"),
        ((16000, 16000), "texels in one picture"),
        ((1000, 1000), "bytes when unpacked"),
        ((500, 500), "chunk offset table"),
    ],
)
def test_a_window_that_is_too_large_is_refused_before_decoding(tmp_path, what, text):
    path = _flat(tmp_path / "a.exr")
    name = b"dataWindow\0box2i\0" + struct.pack("<i", 16)
    old = struct.pack("<4i", 0, 0, W - 1, H - 1)
    _altered(path, name + old, name + struct.pack("<4i", 0, 0, what[0] - 1, what[1] - 1))
    with pytest.raises(LensError, match=text):
        exr.read(path, limits=LIMITS)


def test_a_display_window_far_away_is_refused(tmp_path):
    path = _flat(tmp_path / "a.exr")
    name = b"displayWindow\0box2i\0" + struct.pack("<i", 16)
    old = struct.pack("<4i", 0, 0, W - 1, H - 1)
    _altered(path, name + old, name + struct.pack("<4i", 10**9, 10**9, 10**9 + 5, 10**9 + 5))
    with pytest.raises(LensError, match="data windows and display window together"):
        exr.read(path, limits=LIMITS)


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        (b"compression\0compression\0\1\0\0\0\3", b"compression\0compression\0\1\0\0\0\x63", "compression 99"),
        (b"lineOrder\0lineOrder\0\1\0\0\0\0", b"lineOrder\0lineOrder\0\1\0\0\0\7", "line order 7"),
        (b"channels\0chlist", b"channels\0chlost", "'channels' is missing"),
        (b"dataWindow\0", b"dataWindov\0", "'dataWindow' is missing"),
        (b"G\0\1\0\0\0", b"B\0\1\0\0\0", "list of channels"),
        (b"G\0\1\0\0\0", b"G\0\5\0\0\0", "pixel type 5"),
        (b"G\0\1\0\0\0", b"\n\0\1\0\0\0", "control characters"),
        (b"G\0\1\0\0\0", b"\xff\0\1\0\0\0", "not UTF-8"),
        (b"lineOrder\0lineOrder\0\1\0\0\0", b"lineOrder\0lineOrder\0\xff\xff\xff\xff", "-1 bytes"),
    ],
)
def test_damaged_headers_say_what_is_wrong(tmp_path, before, after, text):
    data = _altered(_flat(tmp_path / "a.exr"), before, after).read_bytes()
    with pytest.raises(ExrError, match=text):
        parse_header(data, len(data))


@pytest.mark.parametrize(("levels", "chunks"), [(0, 6), (1, 6 + 2 + 4), (2, 9 * 6)])
def test_levels_of_detail_are_counted(tmp_path, levels, chunks):
    # Tiles of 16 x 16 over 37 x 21 pixels: 37, 18, 9, 4, 2, 1 and 21, 10, 5, 2, 1 pixels along the edges.
    path = _flat(tmp_path / "a.exr", tiled=True)
    tiles = struct.pack("<2I", 16, 16)
    data = _altered(path, tiles + b"\0", tiles + bytes([levels])).read_bytes()
    assert parse_header(data, len(data)).parts[0].chunks == chunks


@pytest.mark.parametrize("seed", SEEDS)
def test_mutated_files_are_read_or_refused_in_one_line(tmp_path, worker, seed):
    data = SEEDS[seed](tmp_path / "a.exr").read_bytes()
    rng = np.random.default_rng(11)
    path, outcomes = tmp_path / "m.exr", set()
    for _ in range(60):
        changed = np.frombuffer(data, np.uint8).copy()
        # Half of the changes go to the header.
        reach = len(changed) if rng.random() < 0.5 else min(len(changed), 500)
        changed[rng.integers(0, reach, rng.integers(1, 5))] = rng.integers(0, 256)
        path.write_bytes(changed.tobytes())
        try:
            _read(path, worker)
            outcomes.add("read")
        except ValueError as error:
            assert "\n" not in str(error)
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}


def test_pixels_that_are_not_finite_are_noted(tmp_path):
    planes = _planes(np.float32)
    planes["G"][3, 4], planes["Z"][5, 6], planes["Z"][7, 8] = np.nan, np.nan, np.inf
    OpenEXR.File({"type": OpenEXR.scanlineimage}, planes).write(str(tmp_path / "a.exr"))
    expected = "2 pixels with NaN or infinite colour or motion, or NaN depth, are replaced"
    assert frames.read(tmp_path / "a.exr").notes[-1] == expected
