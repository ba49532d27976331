"""The time of a shard, by which a bake plans how many it traces."""

from __future__ import annotations

import time

import numpy as np
import pytest

from lightwell.core.progress import Progress
from lightwell.fields.surface.tracing import trace_shards
from lightwell.scenes import load
from lightwell.scenes.variables import default_variable
from lightwell.transport.shards import ShardSettings, make_shard

SETTINGS = ShardSettings(paths=2, lights=4, points_per_light=8, floor=1)


def lights(count: int, seed: int) -> np.ndarray:
    return np.full((count, 3), (0.0, 0.5, 0.0), np.float32)


@pytest.mark.parametrize("delays", [(1.0, 0.6, 0.0), (1.0, 0.0, 0.6), (1.0,)])
def test_the_first_shard_and_one_pause_do_not_count(tmp_path, delays):
    scene = load("cornell")
    variable, progress = default_variable(scene), Progress(quiet=True)
    # Kernels are compiled before the clock starts.
    make_shard(scene, variable, lights, SETTINGS, 0)

    took = []

    def make(scene, variable, _, settings, index):
        start = time.perf_counter()
        time.sleep(delays[index])
        made = make_shard(scene, variable, lights, settings, index)
        took.append(time.perf_counter() - start)
        return made

    with progress.stage("trace", len(delays), "shards") as stage:
        traced = trace_shards(scene, variable, SETTINGS, tmp_path, len(delays), make, stage)
    # A busy machine may be slow itself: what counts is the time that the shard did take.
    expected = min(took[1:], default=took[0])
    assert expected <= traced.seconds_per_shard < expected + 0.5
