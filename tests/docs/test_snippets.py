"""Every snippet of README, docs and examples is checked; ``make test-all`` also runs them (test_snippets_run.py)."""

import argparse
import ast
import importlib
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import lightwell
from lightwell.api import read_settings
from lightwell.baking.comparison import CompareSettings, parse_fields
from lightwell.baking.settings import BakeSettings
from lightwell.cli.bake import settings
from lightwell.cli.early import check_names
from lightwell.cli.main import VERBS, verb_parser
from lightwell.rendering.settings import RenderSettings

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
FOREIGN = {
    "docker",
    "curl",
    "npm",
    "npx",
    "node",
    "brew",
    "apt",
    "sudo",
    "git",
    "pip",
    "cd",
    "export",
    "man",
    "eval",
} | {"dask", "kubectl"}


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
                _values_are_allowed(
                    verb_parser(given[0], given[1:]).parse_args(given[1:], argparse.Namespace(verb=given[0]))
                )
            except SystemExit as error:
                assert error.code in (0, None), f"{where}: {' '.join(words)} is refused"
            except ValueError as error:
                pytest.fail(f"{where}: {' '.join(words)}: {error}")
    elif program == "make":
        unknown = [t for t in rest if t not in MAKE and t.replace(".venv", "$(VENV)") not in MAKE and "=" not in t]
        assert not unknown, f"{where}: the Makefile has no {unknown}"
    elif program == "python":
        assert rest[0] == "-m" or (ROOT / rest[0]).exists(), f"{where}: there is no {rest[0]}"
    elif program == "npm" and rest[:1] == ["run"]:
        assert rest[1] in NPM, f"{where}: web/package.json has no script {rest[1]}"
    else:
        assert program in FOREIGN, f"{where}: unknown program {program}"


def _values_are_allowed(arguments: argparse.Namespace) -> None:
    """Fields, presets, what may move, and the values of a bake; a mistake is a ``ValueError``."""
    check_names(arguments)
    if arguments.verb == "bake":
        settings(arguments)
    for name in filter(None, (getattr(arguments, "fields", None) or "").split(",")):
        parse_fields(name)


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
            tool = words[2:3] if words[1] == "lens" else []
            known = verb_parser(words[1], tool)._option_string_actions.keys()
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


# What the options of a function are made into.
MADE = {
    "bake": lambda given: BakeSettings(**read_settings(BakeSettings, "cornell", "out", given, own="options")),
    "render": lambda given: RenderSettings(**read_settings(RenderSettings, "cornell", "o", given, "render", "options")),
    "compare": lambda given: CompareSettings(
        fields=parse_fields("mlp"), **read_settings(CompareSettings, "cornell", "out", given, "compare")
    ),
}


@pytest.fixture(scope="module")
def undefined(tmp_path_factory) -> dict[str, list[str]]:
    """Page → the messages on names that its Python uses and does not define; ``wrong`` is a page with one."""
    folder = tmp_path_factory.mktemp("sessions")
    sessions = {"wrong": "print(never_made)"}
    for snippet in _of("python"):
        sessions[str(snippet.page)] = sessions.get(str(snippet.page), "") + snippet.text + "\n"
    names = {f"session_{number}.py": page for number, page in enumerate(sessions)}
    for name, page in names.items():
        (folder / name).write_text(sessions[page])
    options = ["--isolated", "--no-cache", "--select", "F821", "--output-format", "json"]
    done = subprocess.run(
        [sys.executable, "-m", "ruff", "check", *options, folder], capture_output=True, text=True, timeout=60
    )
    found = dict[str, list[str]]()
    for fault in json.loads(done.stdout):
        found.setdefault(names[Path(fault["filename"]).name], []).append(fault["message"])
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_names_are_defined_on_their_page(page, undefined):
    assert undefined.get(str(page), []) == []


def test_an_undefined_name_is_found(undefined):
    assert undefined["wrong"] == ["Undefined name `never_made`"]


def _keywords_exist(snippet: Snippet, node: ast.Call) -> None:
    function = getattr(lightwell, node.func.attr)
    parameters = inspect.signature(function).parameters
    given = {k.arg: k.value for k in node.keywords if k.arg not in parameters}
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        if node.func.attr in MADE:
            _made(snippet, node.func.attr, {name: ast.literal_eval(value) for name, value in given.items()})
        return
    assert not given, f"{snippet.where}: {node.func.attr} has no {list(given)}"


def _made(snippet: Snippet, name: str, given: dict) -> None:
    try:
        MADE[name](given)
    except ValueError as error:
        pytest.fail(f"{snippet.where}: {name}: {error}")


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


def test_every_page_of_docs_is_in_one_list_of_the_index():
    """What the site's build would warn of."""
    index = ROOT / "docs/index.md"
    lists = re.findall(r"^```{toctree}\n(.*?)^```", index.read_text(), re.DOTALL | re.MULTILINE)
    entries = [line for text in lists for line in text.splitlines() if line and line[0] != ":"]
    named = [(index.parent / f"{entry}.md").resolve() for entry in entries]
    assert len(set(named)) == len(named) and all(page.is_file() for page in named)
    others = {ROOT / f"{name}.md" for name in ("CHANGELOG", "CODE_OF_CONDUCT", "THIRD_PARTY")}
    assert set(named) == {*PAGES, *others} - {index}


def test_a_rebake_of_probes_is_lowered_by_nothing_that_it_refuses():
    words = "lightwell bake edited.glb -o new --field probes --rebake out --box=0,0,0,1,1,1".split()
    assert lowered(words) == words
    assert lowered([*words[:5], "--rebake", "out"])[-2:] == ["--paths", "2"]
