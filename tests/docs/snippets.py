"""Find the snippets of README, docs and examples, and lower their budgets so that tests can run them.

A command line runs as it is written, with the options of ``SMALL`` added after it: a later option replaces an earlier
one. A Python snippet runs as it is written, with the replacements of ``SMALL_PYTHON``. CONTRIBUTING.md lists both.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "SECURITY.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").rglob("*.md")),
    *sorted((ROOT / "format").glob("*.md")),
    ROOT / "web/README.md",
    ROOT / "benchmarks/README.md",
]
PAGES = [page for page in PAGES if "_build" not in page.parts]
FENCE = re.compile(r"^( *)(`{3,})([^\n`]*)\n(.*?)^\1\2 *$", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"`(lightwell [^`]*)`")
# What is neither a program nor text that a reader pastes: output, layouts of files, equations.
NOT_RUN = {"text", "json", "html", "toml", "css", "xml", "mermaid"}
PROGRAMS = {"sh", "python", "ts", "tsx", "js", "powershell"}

_BAKE = ["--shards", "1", "--steps", "4", "--paths", "2", "--views", "1", "--truth", "0.1s"]
SMALL: dict[str, list[str]] = {
    "bake": _BAKE,
    "batch": _BAKE,
    "demo": [*_BAKE, "--no-open"],
    "compare": _BAKE,
    "render": ["--size", "32x20", "--spp", "1"],
    "samples": ["--samples", "256", "--paths", "2"],
}
# Options of fields whose defaults take minutes; those that a command gives itself stay.
SMALL_FIELDS = {
    "probes": {"--preset": "draft", "--spacing": "1m"},
    "volume": {"--preset": "draft", "--spacing": "1m"},
    "lightmap": {"--size": "128"},
}
# The 1,200 charts of this scene do not fit into the small atlas.
LOFT_ATLAS = "1024"
# Options that are lowered where a command has them.
SMALLER = {"--frames": "2", "--size": "64", "--largest": "4", "--cluster": "local:1"}
# An error budget that the first round meets; others go on for twenty.
ANY_ERROR = "1000%"
SMALL_PYTHON = [
    (re.compile(r"shards=\d+"), 'shards=1, paths=2, views=1, truth="0.1s"'),
    (re.compile(r'budget="[^"]*"'), 'shards=1, steps=4, paths=2, views=1, truth="0.1s"'),
    (re.compile(r"spp=\d+"), "spp=1"),
    (re.compile(r"steps=\d+"), "steps=4"),
    (re.compile(r"paths=\d+"), "paths=2"),
    (re.compile(r"samples=\d+"), "samples=256"),
]


@dataclass(frozen=True)
class Snippet:
    """A fenced block of a page."""

    page: Path
    line: int
    language: str
    text: str

    @property
    def where(self) -> str:
        """Page and line."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def snippets(page: Path) -> list[Snippet]:
    """List the fenced blocks of a page in their order.

    Args:
        page: Markdown file.

    Returns:
        The blocks; indentation of the fence is removed.
    """
    text = page.read_text()
    found = []
    for match in FENCE.finditer(text):
        lines = [line.removeprefix(match[1]) for line in match[4].splitlines()]
        line = text.count("\n", 0, match.start()) + 1
        found.append(Snippet(page, line, match[3].strip().lower(), "\n".join(lines)))
    return found


def commands(snippet: Snippet) -> list[list[str]]:
    """Split a shell snippet into the words of its commands.

    Args:
        snippet: Block with the language ``sh``.

    Returns:
        The words of each command, without comments; ``.venv/bin/`` is removed from names of programs.
    """
    text = snippet.text.replace("\\\n", " ")
    split = [shlex.split(line, comments=True) for line in text.splitlines()]
    return [[words[0].removeprefix(".venv/bin/"), *words[1:]] for words in split if words]


def inline_commands(page: Path) -> Iterator[tuple[str, str]]:
    """Find commands within sentences.

    Args:
        page: Markdown file.

    Yields:
        Page and line, and the text of the command.
    """
    text = FENCE.sub(lambda match: "\n" * match[0].count("\n"), page.read_text())
    for match in INLINE.finditer(text):
        yield f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, match.start()) + 1}", " ".join(match[1].split())


def lowered(words: list[str]) -> list[str]:
    """Lower the budget of a command.

    Args:
        words: Words of a command of lightwell, with the program's name.

    Returns:
        The words with a small budget.
    """
    verb = words[1] if len(words) > 1 else ""
    added = list(SMALL.get(verb, []))
    if verb == "compare" and "--fields" not in words:
        added = []
    field = words[words.index("--field") + 1] if verb == "bake" and "--field" in words else ""
    for flag, value in SMALL_FIELDS.get(field, {}).items():
        added += [flag, value] if flag not in words else []
    if field == "lightmap" and "loft" in words:
        added[added.index("--size") + 1] = LOFT_ATLAS
    if "--rebake" in words:
        added = [] if field == "probes" else ["--paths", "2"]  # probes repeat the bake in OLD, paths included
    if "--preview" in words:
        added.append("--no-open")
    if any(word.endswith("%") for word in words):
        added += ["--budget", ANY_ERROR]
    if verb != "render":
        for flag, value in SMALLER.items():
            if flag in words and "-" not in words[words.index(flag) + 1]:
                added += [flag, value]
            elif flag == "--frames" and flag in words:
                added += [flag, f"1-{value}"]
    elif "--frames" in words:
        added += ["--frames", "2"]
    return words + added


def small_python(text: str) -> str:
    """Lower the budgets of a Python snippet.

    Args:
        text: Its text.

    Returns:
        The text after all replacements of ``SMALL_PYTHON``.
    """
    for pattern, small in SMALL_PYTHON:
        text = pattern.sub(small, text)
    return text
