"""The page of a batch of bakes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lightwell.report.pages import TEMPLATES


def batch_html(numbers: Mapping[str, Any]) -> str:
    """Build the page.

    Args:
        numbers: Content of ``batch.json``.

    Returns:
        HTML.
    """
    rows = numbers["scenes"]
    counts = {state: sum(row["state"] == state for row in rows) for state in ("done", "failed", "started", "waiting")}
    told = ", ".join(f"{count} {state}" for state, count in counts.items() if count)
    return TEMPLATES.render("batch.html", numbers=numbers, rows=rows, told=told)
