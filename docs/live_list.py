"""Pages that a build has or has not: live pages, which tools/live_pages.py puts into docs/_live.

The directive ``{live-pages}`` lists them. A scene of the zoo that has a live page links to it.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from lightwell.core.units import size_text

FOLDER = Path(__file__).parent / "_live/live"
# The document with a heading for each scene.
ZOO = "docs/zoo"


class LivePages(Directive):
    """Name, picture, verdict and size of each page, with links to page and report."""

    def run(self) -> list[nodes.Node]:
        """Make the list.

        Returns:
            A section for each page, or a sentence where the build has none.
        """
        return listed(FOLDER)


def listed(home: Path) -> list[nodes.Node]:
    """List the pages in a folder.

    Args:
        home: Folder with a baked folder for each page.

    Returns:
        Heading, picture and facts of each, or a sentence where there is none.
    """
    folders = sorted(path.parent for path in home.glob("*/report.json"))
    if not folders:
        return [nodes.paragraph(text="This build of the site has no live pages.")]
    return [node for folder in folders for node in _page(folder)]


def _page(folder: Path) -> list[nodes.Node]:
    report = json.loads((folder / "report.json").read_text())
    address = f"../live/{folder.name}"
    heading = nodes.rubric(text=folder.name)
    facts = f"{size_text(report['bytes'])} of learned light, {report['macs_per_pixel']:,} multiply-adds per pixel; "
    size = size_text((folder / "index.html").stat().st_size)
    text = nodes.paragraph("", f"{report['verdict'] or 'Not judged'}. {facts}")
    text += _link(f"{address}/index.html", f"open the page ({size})")
    text += nodes.Text(", ")
    text += _link(f"{address}/report.html", "its report")
    if not (folder / "page.webp").is_file():
        return [heading, text]
    picture = nodes.raw("", f'<img src="{address}/page.webp" alt="{folder.name}" width="480">', format="html")
    return [heading, picture, text]


def _link(address: str, text: str) -> nodes.Node:
    return nodes.reference(text, text, refuri=address)


def add_links(app: Sphinx, name: str, source: list[str]) -> None:
    """Put a link to its live page below the heading of each scene that has one.

    Args:
        app: The application.
        name: Document that was read.
        source: Its text, changed in place.
    """
    if name == ZOO:
        source[0] = linked(source[0], FOLDER)


def linked(text: str, home: Path) -> str:
    """Add links to live pages.

    Args:
        text: A document with headings ``## SCENE``.
        home: Folder with a baked folder for each page.

    Returns:
        The document; scenes without a page are left as they are.
    """

    def link(heading: re.Match[str]) -> str:
        if not (home / heading[1] / "index.html").is_file():
            return heading[0]
        return f'{heading[0]}\n<a href="../live/{heading[1]}/index.html">Move the lamp in it</a>\n'

    return re.sub(r"^## ([\w.-]+)\n", link, text, flags=re.MULTILINE)


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive and the hook.

    Args:
        app: The application.

    Returns:
        Facts about the extension.
    """
    app.add_directive("live-pages", LivePages)
    app.connect("source-read", add_links)
    # These depend on files beside their pages.
    places = ["docs/live-pages", ZOO]
    app.connect("env-get-outdated", lambda app, env, *_: [name for name in places if name in env.found_docs])
    return {"parallel_read_safe": True, "version": "1"}
