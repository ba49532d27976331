"""Frozen samples: the same bytes whatever happens, and refusals that say what to do."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from lightwell.core.store import Store
from lightwell.transport import radiance
from lightwell.transport.collect import collect, join
from lightwell.transport.interactions import interaction
from lightwell.transport.queries import make_query
from lightwell.transport.shards import ShardSettings, generate, load_samples
from lightwell.transport.surface import sample_surface

SETTINGS = ShardSettings(lights=8, points_per_light=16, floor=2)


def lights(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform((-0.8, 0.2, -0.8), (0.8, 1.8, 0.8), (count, 3)).astype(np.float32)


def contents(folder) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def run(scene, variable, folder, shards=3, seed=5, **options):
    return generate(scene, variable, lights, folder, shards, paths=4, seed=seed, settings=SETTINGS, **options)


def test_an_interrupted_run_ends_with_the_same_bytes(cornell, roaming, tmp_path):
    class Killed(RuntimeError):
        pass

    def kill(done, _):
        if done == 2:
            raise Killed

    report = run(cornell, roaming, tmp_path / "whole")
    with pytest.raises(Killed):
        run(cornell, roaming, tmp_path / "killed", progress=kill)
    # As a kill within a shard leaves it: a temporary folder with a part of the files.
    part = tmp_path / "killed" / "samples.shard" / ".0123.columns.1.1.part"
    part.mkdir()
    (part / "half_a.npy").write_bytes(b"half a file")
    resumed = run(cornell, roaming, tmp_path / "killed")
    Store(tmp_path / "killed").sweep(age=0)
    assert contents(tmp_path / "whole") == contents(tmp_path / "killed")
    assert report == resumed and report.paths == 3 * 128 * 4


def test_samples_are_light_major_and_complete(cornell, roaming, tmp_path):
    run(cornell, roaming, tmp_path)
    samples = load_samples(tmp_path, cornell)
    assert len(samples) == 3 * 128
    by_light = samples.query.light.reshape(24, 16, 3)
    assert (by_light == by_light[:, :1]).all() and len(np.unique(by_light[:, 0], axis=0)) == 24
    assert all(a.dtype == np.float32 for a in (samples.half_a, samples.query.position, samples.weight))
    assert len(load_samples(tmp_path, shards=1)) == 128


def test_seeds_give_different_samples(cornell, roaming, tmp_path):
    run(cornell, roaming, tmp_path / "a", shards=1, seed=1)
    run(cornell, roaming, tmp_path / "b", shards=1, seed=2)
    a, b = (load_samples(tmp_path / n) for n in "ab")
    assert not np.isin(a.query.position[:, 0], b.query.position[:, 0]).all()
    assert not np.isin(a.query.light, b.query.light).any()


def test_refusals(cornell, roaming, tmp_path):
    with pytest.raises(ValueError, match=r"has no readable manifest.json .* run generate\(\) first"):
        load_samples(tmp_path / "nothing")
    run(cornell, roaming, tmp_path, shards=1)
    other = replace(cornell, digest="another")
    with pytest.raises(ValueError, match=r"made for another scene .*choose another folder or delete this one"):
        load_samples(tmp_path, other)
    with pytest.raises(ValueError, match="made for another scene"):
        run(other, roaming, tmp_path, shards=1)
    with pytest.raises(ValueError, match=r"made with other settings \(seed\)"):
        run(cornell, roaming, tmp_path, shards=1, seed=6)
    with pytest.raises(ValueError, match="holds 1 of 2 shards"):
        load_samples(tmp_path, shards=2)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    (tmp_path / "manifest.json").write_text(json.dumps({**manifest, "version": 99}))
    with pytest.raises(ValueError, match="version 99, expected 10"):
        load_samples(tmp_path)


def test_a_damaged_shard_is_made_again(cornell, roaming, tmp_path, caplog):
    run(cornell, roaming, tmp_path / "whole", shards=2)
    run(cornell, roaming, tmp_path / "damaged", shards=2)
    column = next((tmp_path / "damaged").glob("samples.shard/*/half_a.npy"))
    data = bytearray(column.read_bytes())
    data[-3] ^= 1
    column.write_bytes(data)
    run(cornell, roaming, tmp_path / "damaged", shards=2)
    assert "is damaged and is made again" in caplog.text
    assert contents(tmp_path / "whole") == contents(tmp_path / "damaged")


def test_a_shard_of_another_run_is_never_read(cornell, roaming, tmp_path):
    """Two runs once wrote into one folder: the samples of the second were trained on as if they were the first's."""
    run(cornell, roaming, tmp_path / "mine", shards=2)
    run(cornell, roaming, tmp_path / "other", shards=2, seed=6)
    mine = load_samples(tmp_path / "mine")
    for path in (tmp_path / "mine" / "samples.shard").iterdir():
        shutil.rmtree(path)
    shutil.copytree(tmp_path / "other" / "samples.shard", tmp_path / "mine" / "samples.shard", dirs_exist_ok=True)
    with pytest.raises(ValueError, match="holds 0 of 2 shards"):
        load_samples(tmp_path / "mine", shards=2)
    run(cornell, roaming, tmp_path / "mine", shards=2)
    assert np.array_equal(load_samples(tmp_path / "mine").query.position, mine.query.position)


def test_samples_without_a_finite_path_weigh_nothing(monkeypatch, cornell, roaming):
    trace = radiance.trace

    def broken(scene, si, *rest):
        return radiance.dr.select(si.p.x < 0, float("nan"), trace(scene, si, *rest))

    monkeypatch.setattr(radiance, "trace", broken)
    points = sample_surface(cornell, 256, 1)
    samples = collect(cornell, roaming, points, (0, 1.5, 0), 4, 0)
    left = samples.query.position[:, 0] < 0
    assert (samples.weight[left] == 0).all() and (samples.weight[~left] == 1).all()
    assert np.isfinite(samples.radiance).all()
    assert len(join([samples, samples[:10]])) == 266


def test_queries(cornell):
    points = sample_surface(cornell, 256, 2)
    query = make_query(cornell, points, (0, 1.5, 0))
    np.testing.assert_allclose(query.position, np.array(interaction(cornell, points).p).T, atol=1e-6)
    assert query.light.shape == (256, 3) and query.roughness.shape == query.metallic.shape == (256, 1)
    assert (query.reflectance >= 1e-3).all()
    # The camera is in the room: normals point into it.
    assert ((query.normal * ([0, 1, 0] - query.position)).sum(axis=1)[np.isin(points.shape, [0, 1, 2, 3, 4])] > 0).all()
