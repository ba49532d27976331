"""What objects show of themselves in notebooks: a title, pictures and a table."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from lightwell.core.templates import Templates

TEMPLATES = Templates(Path(__file__).parent / "notebook_templates")


def card(
    title: str,
    rows: Sequence[Sequence[object]],
    *,
    text: str = "",
    pictures: Mapping[str, str] | None = None,
    headings: Sequence[str] = (),
) -> str:
    """Describe an object as HTML.

    Args:
        title: Its name.
        rows: Cells of a table.
        text: A sentence below the title; empty: none.
        pictures: Caption → data URI.
        headings: Headings of the table; empty: none.

    Returns:
        HTML; every text is escaped.
    """
    pairs = list((pictures or {}).items())
    return TEMPLATES.render("card.html", title=title, text=text, pictures=pairs, rows=rows, headings=headings)


def png_uri(pixels: np.ndarray) -> str:
    """Encode a picture as a data URI.

    Args:
        pixels: [H, W, 3] uint8 sRGB.

    Returns:
        ``data:image/png;base64,…``.
    """
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}"
