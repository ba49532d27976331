"""The page of each verb in docs/how-to names all of its options, and each verb is in the reference."""

import re
from pathlib import Path

import pytest

from lightwell.cli.main import VERBS, verb_parser
from lightwell.cli.whole_parser import whole_verbs

DOCS = Path(__file__).parents[2] / "docs"
REFERENCE = (DOCS / "reference/command-line.md").read_text()
# Options that many verbs have: the reference explains them once.
SHARED = {"--help", "--out"}


@pytest.mark.parametrize("words", whole_verbs(), ids=" ".join)
def test_options_are_documented(words):
    verb = words[0]
    assert f"```{{verb-help}} {' '.join(words)}\n" in REFERENCE and f"(../how-to/{verb}.md)" in REFERENCE
    page = (DOCS / f"how-to/{verb}.md").read_text()
    # Demo and batch are bakes, and say so.
    text = REFERENCE + page + ((DOCS / "how-to/bake.md").read_text() if verb in ("demo", "batch") else "")
    options = {
        o for a in verb_parser(verb, words[1:])._actions for o in a.option_strings if o.startswith("--")
    } - SHARED
    missing = sorted(o for o in options if not re.search(rf"(?<![\w-]){o}(?![\w-])", text))
    assert not missing


def test_every_page_belongs_to_a_verb():
    assert {page.stem for page in (DOCS / "how-to").glob("*.md")} == set(VERBS)
