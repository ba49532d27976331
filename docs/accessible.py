"""Mends what the theme's pages lack for keyboards and screen readers; tools/check-site.mjs finds what is left."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

# Markup of the theme → the same with a heading level, a name, or a place in the order of the keyboard.
MENDED = {
    'class="caption" role="heading">': 'class="caption" role="heading" aria-level="2">',
    "<pre>": '<pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="Pages">',
    '<div id="search-results"></div>': '<h1>Search</h1><div id="search-results"></div>',
    '<aside class="toc-drawer': '<aside aria-label="On this page" class="toc-drawer',
}


def mend(app: Sphinx, error: Exception | None) -> None:
    """Replace the markup in all written pages.

    Args:
        app: The application.
        error: What ended the build early, if anything.
    """
    if error or app.builder.format != "html":
        return
    for page in Path(app.outdir).rglob("*.html"):
        text = before = page.read_text()
        for markup, mended in MENDED.items():
            text = text.replace(markup, mended)
        if text != before:
            page.write_text(text)


def setup(app: Sphinx) -> dict[str, Any]:
    """Mend pages when the build has ended.

    Args:
        app: The application.

    Returns:
        Facts about the extension.
    """
    app.connect("build-finished", mend)
    return {"parallel_read_safe": True, "version": "1"}
