"""docs/command-line.md names every verb and every option."""

import re
from pathlib import Path

import pytest

from lightwell.cli.main import VERBS, verb_parser

TEXT = (Path(__file__).parents[1] / "docs/command-line.md").read_text()


@pytest.mark.parametrize("verb", VERBS)
def test_options_are_documented(verb):
    assert f"## {verb}\n" in TEXT and f"[`{verb}`](#{verb})" in TEXT
    options = {o for a in verb_parser(verb)._actions for o in a.option_strings if o.startswith("--")} - {
        "--help",
        "--out",
    }
    missing = sorted(o for o in options if not re.search(rf"(?<![\w-]){o}(?![\w-])", TEXT))
    assert not missing
