"""Table of the reports of several bakes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

# (key in the rows, heading, how it is printed).
COLUMNS = (
    ("out", "bake", "{}"),
    ("scene", "scene", "{}"),
    ("field", "field", "{}"),
    ("relative_error", "error", "{:.2%}"),
    ("noise_floor", "noise", "{:.2%}"),
    ("psnr_db", "PSNR dB", "{:.2f}"),
    ("ssim", "SSIM", "{:.4f}"),
    ("flip", "FLIP", "{:.4f}"),
    ("bytes", "bytes", "{:,}"),
    ("macs_per_pixel", "MAC/px", "{:,}"),
    ("trace", "trace s", "{:.1f}"),
    ("train", "train s", "{:.1f}"),
)


def comparison(outs: list[Path]) -> list[dict[str, Any]]:
    """Read the figures of several reports; a folder without a report is a ``ValueError``.

    Args:
        outs: Folders written by bakes.

    Returns:
        Figures by name for each folder, in the order given.
    """
    return [_row(out) for out in outs]


def _row(out: Path) -> dict[str, Any]:
    path = out / "report.json"
    try:
        report = json.loads(path.read_text())
    except FileNotFoundError:
        raise ValueError(
            f"compare: '{out}' has no report.json; name folders that 'lightwell bake' has written"
        ) from None
    except (OSError, ValueError) as error:
        raise ValueError(f"compare: '{path}' cannot be read ({error}); bake again") from error
    row = {key: report.get(key) for key, _, _ in COLUMNS}
    seconds = report.get("seconds", {})
    row |= {"out": str(out), "trace": seconds.get("trace"), "train": seconds.get("train")}
    return row | {"field": f"{report.get('field')} {report.get('preset')}"}


def table(rows: list[dict[str, Any]]) -> str:
    """Format figures as text.

    Args:
        rows: The result of ``comparison``.

    Returns:
        Aligned lines.
    """
    return aligned(rows, COLUMNS)


def cells(rows: Sequence[dict[str, Any]], columns: Sequence[tuple[str, str, str]]) -> list[list[str]]:
    """Format the cells of a table.

    Args:
        rows: Values by key; None is written as a dash.
        columns: (key, heading, format) of each column.

    Returns:
        The headings, then the texts of each row.
    """
    found = [[heading for _, heading, _ in columns]]
    for row in rows:
        found.append(["–" if row[key] is None else form.format(row[key]) for key, _, form in columns])
    return found


def aligned(rows: Sequence[dict[str, Any]], columns: Sequence[tuple[str, str, str]]) -> str:
    """Format a table as text.

    Args:
        rows: Values by key; None is written as a dash.
        columns: (key, heading, format) of each column.

    Returns:
        Aligned lines.
    """
    lines = cells(rows, columns)
    widths = [max(len(line[k]) for line in lines) for k in range(len(columns))]
    return "\n".join("  ".join(text.rjust(width) for text, width in zip(line, widths)) for line in lines)
