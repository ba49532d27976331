"""The field: its graph means its prediction, its files hold its light, and light adds."""

from dataclasses import replace

import numpy as np
import pytest

from lightwell.fields import FieldSetup
from lightwell.fields.probes import PRESETS, ProbesFit
from lightwell.graph import evaluate
from lightwell.probes.file import read
from lightwell.probes.light import Effort
from lightwell.probes.volume import query
from lightwell.scenes import load
from lightwell.scenes.variables import declare

TINY = replace(
    PRESETS["draft"],
    states=6,
    rank=3,
    effort=Effort(4, 16, 16),
    static_effort=Effort(4, 16, 16),
    bricks=0.5,
    hidden=(8,),
)


@pytest.fixture(scope="module")
def moving():
    scene = load("two-rooms")
    variable = declare((), scene)
    return ProbesFit(FieldSetup.of(scene, 1.0, variable.kind, variable, 1.0), TINY, 3)


def places(count: int = 400):
    rng = np.random.default_rng(0)
    n = rng.standard_normal((count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    x = rng.uniform([-2.5, 0.3, -1.5], [2.5, 2.2, 1.5], (count, 3))
    return x.astype(np.float32), n.astype(np.float32)


def test_the_graph_means_the_volume_under_any_light(moving):
    x, n = places()
    for light in ([-1.5, 1.5, 0.2], [1.4, 1.0, -0.5]):
        volume = moving.volume(np.array(light), 1.0)
        expected = query(volume, x, n)[0] / np.pi
        inputs = {"position": x, "normal": n, "light": np.tile(np.float32(light), (len(x), 1))}
        found = evaluate(moving.lower(), inputs)["radiance"]
        assert np.abs(found - expected).max() < 0.03 * np.abs(volume.light[:, 0]).max()


def test_light_adds_and_scales(moving):
    a, b = (moving.volume(np.array(p), 1.0) for p in ([-1.5, 1.5, 0.2], [1.4, 1.0, -0.5]))
    assert np.array_equal(a.params, b.params) and np.array_equal(a.state, b.state)
    twice = moving.volume(np.array([-1.5, 1.5, 0.2]), np.array([2.0, 0.5, 0.0]))
    assert np.allclose(twice.light, a.light * [2.0, 0.5, 0.0], atol=1e-6)


def test_a_bake_writes_the_volume_and_its_page(moving, tmp_path):
    light = np.array([-1.5, 1.5, 0.2])
    moving.write_files(tmp_path, "indirect", b"glTF", light, np.ones(3))
    found, volume = read(tmp_path / "probes-indirect.lwp"), moving.volume(light, 1.0)
    assert (tmp_path / "probes.html").stat().st_size > 1e5
    assert np.array_equal(found.state, volume.state) and moving.facts["file_bytes_per_probe"]["light"] >= 20
    assert np.allclose(found.light[:, 0], volume.light[:, 0], rtol=2e-3, atol=1e-3 * np.abs(volume.light).max())


def test_the_report_tells_of_the_baselines(moving):
    told = moving.facts["baselines"]
    assert set(told) == {"learned", "trilinear", "trilinear + validity", "DDGI", "line of sight"}
    assert told["learned"]["smape"] < told["trilinear"]["smape"]
    assert all(0 <= value <= 1 for row in told.values() for value in row.values())


def test_a_network_per_probe_has_no_file(moving, tmp_path):
    other = object.__new__(ProbesFit)
    other.preset = PRESETS["mlp"]
    other.write_files(tmp_path, "indirect", b"", np.zeros(3), 1.0)
    assert not list(tmp_path.iterdir())
