"""Libraries of these tests live in a temporary cache, so that a user's cache is neither read nor written."""

from pathlib import Path

import pytest

GIVEN = Path(__file__).resolve().parents[3] / "shared" / "scenes" / "postfx"


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LIGHTWELL_STORE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def given():
    """The given EXR files and masks; tests that need them skip where they are absent."""
    if not GIVEN.exists():
        pytest.skip("the given scenes are not on this machine")
    return GIVEN
