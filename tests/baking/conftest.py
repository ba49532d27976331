"""A bake that is as small as a bake can be, made once."""

from pathlib import Path

import pytest

from lightwell.baking.pipeline import bake
from lightwell.baking.settings import BakeSettings
from lightwell.fields.budget import Budget


def small(out: Path, **changes) -> BakeSettings:
    """Settings of a bake that takes seconds: 4,096 samples, 60 steps, two tiny views."""
    settings = {
        "scene": "cornell",
        "out": out,
        "shards": 2,
        "steps": 60,
        "paths": 8,
        "lights_per_shard": 32,
        "views": 2,
        "view_size": (24, 16),
        # The least of a reference: these tests look at what is written, not at how good it is.
        "truth": Budget(0.05),
    }
    return BakeSettings(**(settings | changes))


@pytest.fixture(scope="session")
def baked(tmp_path_factory):
    """(folder, report) of a small bake of the Cornell box."""
    out = tmp_path_factory.mktemp("bake") / "out"
    return out, bake(small(out))
