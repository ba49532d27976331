"""Files of probe volumes: what is written is read, what is damaged is refused in one line."""

import json

import numpy as np
import pytest
from test_lattice_and_query import bricked, made_up, queries

from lightwell.probes import ddgi, sh
from lightwell.probes.file import MAGIC, decode_volume, encode_volume, read, read_baselines, write
from lightwell.probes.volume import query
from lightwell.probes.weights import FUNCTIONS


@pytest.mark.parametrize("coding", ["l2", "zh3"])
@pytest.mark.parametrize("make", [made_up, bricked])
def test_what_is_written_is_read(tmp_path, make, coding):
    volume = make()
    parts = write(volume, tmp_path / "v.lwp", coding)
    found = read(tmp_path / "v.lwp")
    for name in ("state", "row", "params", "octant", "in_doubt"):
        assert np.array_equal(getattr(found, name), getattr(volume, name)), name
    assert np.array_equal(found.fallback, np.where(volume.in_doubt[:, None], volume.fallback, -1))
    assert len(volume.sheets.plane) > 10
    for name in ("row", "plane", "corners"):
        assert np.array_equal(getattr(found.sheets, name), getattr(volume.sheets, name)), name
    if volume.bricks is not None:
        for name in ("cell", "table", "inner", "sheet"):
            assert np.array_equal(getattr(found.bricks, name), getattr(volume.bricks, name)), name
    live = volume.alive
    window = sh.windowed(volume.light, sh.deringing(volume.light))
    expected = window if coding == "l2" else sh.from_zh3(sh.zh3(window))
    # The axis of band 2 turns a little with the bytes of band 1.
    step = np.abs(expected[:, 1:]).max(axis=(1, 2)) / (100 if coding == "l2" else 15)
    assert (np.abs(found.light - expected).max(axis=(1, 2)) < np.maximum(step, 4e-3))[live].mean() > 0.97
    assert parts["light"] * live.sum() == {"l2": 32, "zh3": 20}[coding] * live.sum()
    # What is told of a volume is what its file takes, but for the padding of records.
    told = sum(size for part, size in volume.bytes_per_probe(coding).items() if part != "record")
    assert sum(parts.values()) == pytest.approx(told)
    # The trusted share does not depend on the light.
    x, n = queries(500)
    assert np.array_equal(query(found, x, n)[1], query(volume, x, n)[1])


@pytest.mark.parametrize("function", list(FUNCTIONS))
def test_every_weight_function_has_a_file(function):
    volume = bricked(function)
    found = decode_volume(encode_volume(volume, "l2")[0])
    assert found.function == function and np.allclose(found.params, volume.params, rtol=1e-5, atol=1e-6)
    x, n = queries(500)
    assert np.abs(query(found, x, n)[1] - query(volume, x, n)[1]).max() < 1e-5


def moments(lattice) -> ddgi.Moments:
    rng, count = np.random.default_rng(3), len(lattice)
    mean = rng.random((count, ddgi.SIDE, ddgi.SIDE)) * 0.7
    maps = np.stack([mean, mean**2 + 0.05], axis=-1).astype(np.float32)
    origin = (lattice.nodes() + rng.normal(0, 0.1, (count, 3))).astype(np.float32)
    light = made_up(seed=5).light
    return ddgi.Moments(lattice, origin, rng.random(count) > 0.2, maps, light, 0.0)


def test_a_file_holds_the_baselines_too(tmp_path):
    volume = bricked()
    expected, path = moments(volume.lattice), tmp_path / "v.lwp"
    path.write_bytes(encode_volume(volume, "l2", baselines=expected)[0])
    found = read_baselines(path)
    x, n = queries(500)
    assert np.array_equal(found.alive, expected.alive) and np.allclose(found.origin, expected.origin)
    a, b = (ddgi.shares(m, x, n)[1] for m in (found, expected))
    # Half floats of the mean square.
    assert np.quantile(np.abs(a - b), 0.99) < 0.02
    assert np.array_equal(query(read(path), x, n)[1], query(volume, x, n)[1])
    write(volume, path)
    assert read_baselines(path) is None


def test_light_of_a_file_is_not_negative():
    volume = made_up()
    rng = np.random.default_rng(0)
    wild = volume.lit(rng.normal(0, 1, volume.light.shape) + np.eye(9)[0][:, None] * 4)
    found = decode_volume(encode_volume(wild, "l2")[0])
    e = np.einsum("dk,pkc->pdc", sh.basis(sh.directions(256)), found.light[volume.alive])
    # Half a step of each of eight bytes.
    assert e.min() > -0.05 * np.abs(found.light).max()


def test_the_same_volume_gives_the_same_bytes():
    assert encode_volume(bricked())[0] == encode_volume(bricked())[0]


def _changed(data: bytes, **changes) -> bytes:
    size = int.from_bytes(data[8:12], "little")
    header = json.loads(data[12 : 12 + size]) | changes
    text = json.dumps(header).encode()
    return MAGIC + len(text).to_bytes(4, "little") + text + data[12 + size :]


@pytest.mark.parametrize(
    "changes",
    [
        {"version": 2},
        {"shape": [5, 4, 100000]},
        {"shape": [5, 4]},
        {"spacing": -1.0},
        {"spacing": "1"},
        {"origin": [0, 0, 1e300]},
        {"coding": "l3"},
        {"function": "wavelet"},
        {"function": ["mlp"]},
        {"function": "mlp"},
        {"unit": None},
        {"sections": None},
        {"sections": {"kinds": [0, 1 << 40]}},
        {"sections": {"kinds": [-4, 2]}},
    ],
)
def test_a_damaged_header_is_refused(changes):
    with pytest.raises(ValueError, match=r"file\.lwp: "):
        decode_volume(_changed(encode_volume(bricked())[0], **changes), "file.lwp")


def test_damaged_words_are_refused_or_harmless():
    data, rng = encode_volume(bricked())[0], np.random.default_rng(0)
    x, n = queries(20)
    for _ in range(60):
        broken = bytearray(data)
        for at in rng.integers(0, len(data), 8):
            broken[at] = rng.integers(0, 256)
        try:
            volume = decode_volume(bytes(broken), "file.lwp")
        except ValueError as error:
            assert "\n" not in str(error)
            continue
        assert np.isfinite(query(volume, x, n)[0]).all()
    for size in (0, 5, 11, 40, len(data) - 2):
        with pytest.raises(ValueError):
            decode_volume(data[:size], "file.lwp")
