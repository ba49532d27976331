"""A bake that is as small as a bake can be, made once."""

from pathlib import Path

import pytest

from lightwell.baking import BakeSettings, bake


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
        "view_size": (48, 32),
    }
    return BakeSettings(**(settings | changes))


@pytest.fixture(scope="session", autouse=True)
def little_truth():
    """A truth of a second instead of twelve: these tests look at what is written, not at how good it is."""
    from lightwell.baking import effort

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(effort, "EVALUATION_SHARE", 0.0)
        patch.setattr(effort, "EVALUATION_LEAST", 1.0)
        yield


@pytest.fixture(scope="session")
def baked(tmp_path_factory):
    """(folder, report) of a small bake of the Cornell box."""
    out = tmp_path_factory.mktemp("bake") / "out"
    return out, bake(small(out))
