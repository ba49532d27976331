"""An error budget works in rounds: it stops when the error is met, and gives up with a word when it is not."""

from lightwell.baking.pipeline import bake
from lightwell.core.progress import Progress
from lightwell.fields.budget import Budget

from .conftest import small

# A field without kernels, on few samples: these tests look at rounds alone.
TINY = {"field": "tree", "views": 1, "view_size": (24, 16), "shards": 1, "lights_per_shard": 8, "steps": 20}


class Heard(Progress):
    """Silent bars; keeps what was said."""

    def __init__(self):
        super().__init__(quiet=True)
        self.said = []

    def say(self, text):
        self.said.append(text)


def test_a_goal_that_is_met_ends_after_the_first_round(tmp_path):
    report = bake(small(tmp_path, **TINY, budget=Budget(None, 50.0)))
    assert report["settings"]["plans"]["indirect"]["steps"] == 20


def test_a_goal_that_is_not_met_takes_more_rounds_and_says_so(tmp_path):
    heard = Heard()
    report = bake(small(tmp_path, **TINY, budget=Budget(None, 1e-6, rounds=2)), heard)
    assert report["settings"]["plans"]["indirect"]["steps"] > 20
    assert any("asked for" in text for text in heard.said)
