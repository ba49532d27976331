"""Every snippet of README, docs and examples is checked; ``make test-all`` also runs them (test_snippets_run.py)."""

import argparse
import ast
import importlib
import inspect
import json
import re

import pytest

import lightwell
from lightwell.cli.main import VERBS, verb_parser

from .snippets import (
    INLINE,
    NOT_RUN,
    PAGES,
    PROGRAMS,
    ROOT,
    Snippet,
    commands,
    inline_commands,
    lowered,
    snippets,
)

ALL = [snippet for page in PAGES for snippet in snippets(page)]
MAKE = re.findall(r"^([\w.$()/-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
NPM = json.loads((ROOT / "web/package.json").read_text())["scripts"]
# Programs that are not lightwell's, and that need a network, a login or another machine.
FOREIGN = {"docker", "curl", "npm", "npx", "node", "brew", "apt", "sudo", "git", "pip", "cd", "export", "man", "eval"}


def _of(language: str) -> list[Snippet]:
    return [snippet for snippet in ALL if snippet.language == language]


def test_every_block_names_its_language():
    unknown = [f"{s.where}: '{s.language}'" for s in ALL if s.language.split(" ")[0] not in PROGRAMS | NOT_RUN]
    unknown = [line for line in unknown if "{" not in line]  # directives of MyST
    assert not unknown


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_are_understood(page):
    for snippet in snippets(page):
        for words in commands(snippet) if snippet.language == "sh" else ():
            _understood(snippet.where, words)


def _understood(where: str, words: list[str]) -> None:
    """Parse a command; files that it runs exist."""
    program, rest = words[0], words[1:]
    if program == "lightwell":
        verb = rest[0] if rest else "--help"
        assert verb in VERBS or verb.startswith("-"), f"{where}: unknown verb in {words}"
        for given in (rest, lowered(words)[1:]) if verb in VERBS else ():
            try:
                verb_parser(given[0], given[1:]).parse_args(given[1:], argparse.Namespace(verb=given[0]))
            except SystemExit as error:
                assert error.code in (0, None), f"{where}: {' '.join(words)} is refused"
    elif program == "make":
        unknown = [t for t in rest if t not in MAKE and t.replace(".venv", "$(VENV)") not in MAKE and "=" not in t]
        assert not unknown, f"{where}: the Makefile has no {unknown}"
    elif program == "python":
        assert rest[0] == "-m" or (ROOT / rest[0]).exists(), f"{where}: there is no {rest[0]}"
    elif program == "npm" and rest[:1] == ["run"]:
        assert rest[1] in NPM, f"{where}: web/package.json has no script {rest[1]}"
    else:
        assert program in FOREIGN, f"{where}: unknown program {program}"


def test_options_within_sentences_exist():
    wrong = []
    for page in PAGES:
        for where, text in inline_commands(page):
            words = text.split()
            if words[1].startswith("-") or words[1] in ("VERB", "…"):
                continue
            if words[1] not in VERBS:
                wrong.append(f"{where}: no verb {words[1]}")
                continue
            known = {flag for action in verb_parser(words[1])._actions for flag in action.option_strings}
            given = {word.split("=")[0] for word in words[2:] if word.startswith("--") and len(word) > 2}
            wrong += [f"{where}: {words[1]} has no {flag}" for flag in sorted(given - known)]
    assert not wrong


def test_the_check_of_sentences_finds_commands():
    assert INLINE.findall("see `lightwell bake room.glb --budget 5m` there") == ["lightwell bake room.glb --budget 5m"]


@pytest.mark.parametrize("snippet", _of("python"), ids=lambda snippet: snippet.where)
def test_python_uses_what_exists(snippet):
    """Imports resolve, names of lightwell exist, and functions have the keyword arguments that are given."""
    tree = ast.parse(snippet.text)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("lightwell"):
            module = importlib.import_module(node.module)
            missing = [a.name for a in node.names if not hasattr(module, a.name)]
            assert not missing, f"{snippet.where}: {node.module} has no {missing}"
        elif isinstance(node, ast.Import):
            for alias in node.names:
                importlib.import_module(alias.name)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if isinstance(node.func.value, ast.Name) and node.func.value.id == "lightwell":
                _keywords_exist(snippet, node)


def _keywords_exist(snippet: Snippet, node: ast.Call) -> None:
    function = getattr(lightwell, node.func.attr)
    parameters = inspect.signature(function).parameters
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        return
    unknown = [k.arg for k in node.keywords if k.arg not in parameters]
    assert not unknown, f"{snippet.where}: {node.func.attr} has no {unknown}"


def test_links_between_pages_lead_somewhere():
    """Links to files of the repository; the site's build checks those to headings."""
    broken = []
    for page in PAGES:
        text = re.sub(r"`[^`]*`|```.*?```", "", page.read_text(), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            if re.match(r"[a-z]+:", target) or target.startswith("#"):
                continue
            if not (page.parent / target.split("#")[0]).exists():
                broken.append(f"{page.relative_to(ROOT)}: {target}")
    assert not broken
