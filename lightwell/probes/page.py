"""Writes the page of a probe volume: one HTML file with the scene, a movable object, the probes and their weights."""

from __future__ import annotations

import os
from base64 import b64encode
from importlib.resources import files
from pathlib import Path

from lightwell.core.templates import Templates
from lightwell.files import write_atomically

TEMPLATES = Templates(Path(__file__).parent / "templates")
PLACE = "<!--lightwell-probes-->"


def write_page(path: str | os.PathLike[str], volume: bytes, glb: bytes, shell: str | None = None) -> None:
    """Write the page of a volume and its scene, with links to the scene's page and report beside it.

    Args:
        path: File to write.
        volume: Bytes of ``file.encode_volume``.
        glb: The baked asset.
        shell: HTML of the page; None for the one that is built into the package.

    Raises:
        RuntimeError: The page does not contain the placeholder for its data exactly once.
    """
    shell = files("lightwell").joinpath("viewer/probes.html").read_text("utf-8") if shell is None else shell
    if shell.count(PLACE) != 1:
        raise RuntimeError(f"probes: the page must contain {PLACE} once, found {shell.count(PLACE)}")
    parts = {"lightwell-volume": b64encode(volume).decode(), "lightwell-scene": b64encode(glb).decode()}
    write_atomically(Path(path), shell.replace(PLACE, TEMPLATES.render("data.html", parts=parts)))
