"""The viewer page: one HTML file with the built viewer, an asset, its views and its report."""

from __future__ import annotations

import base64
import gzip
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from lightwell.asset.page_picture import dark_radiance, pack_picture
from lightwell.asset.page_textures import with_smaller_textures
from lightwell.asset.without_ktx2 import without_ktx2
from lightwell.core.templates import Templates
from lightwell.files import write_atomically

if TYPE_CHECKING:
    from lightwell.scenes.scene import Camera

TEMPLATES = Templates(Path(__file__).parent / "templates")
PLACEHOLDER = "<!--lightwell-data-->"


@dataclass(frozen=True)
class PageView:
    """A held-out view that the page offers for comparison."""

    name: str
    """Name in the page's list."""
    camera: Camera
    """Camera of the view."""
    light: tuple[float, float, float]
    """Value of the variable: position (metres) or unit direction to the sun."""
    reference: np.ndarray
    """[height, width, 3] path-traced total radiance for the variable's intensity and colour, first row at the top."""
    pose: tuple[float, ...] | None = None
    """A slider, 0 to 1, for each of the scene's movers; None: nothing moves."""
    further: tuple[tuple[float, float, float], ...] = ()
    """Values of the variables of further lights."""


def write_page(
    path: str | Path,
    *,
    title: str,
    glb: bytes,
    home: Camera,
    views: Sequence[PageView] = (),
    exposure: float | None = None,
    report: Mapping[str, Any] | None = None,
    viewer: str | None = None,
    links: Mapping[str, str] | None = None,
) -> int:
    """Write the viewer page as one self-contained HTML file.

    Args:
        path: File to write.
        title: Title of the page.
        glb: The baked asset; the page carries it with decoded KTX2 pictures (``without_ktx2``) and with smaller
            textures (``with_smaller_textures``), gzip-compressed.
        home: Camera at which the page opens.
        views: Held-out views with path-traced references, offered for comparison.
        exposure: Factor on radiance before tone mapping, > 0; None: metered by the page.
        report: Content of report.json; None when there is no report.
        viewer: HTML of the viewer; None for the one that is built into the package.
        links: Text → relative path of pages beside this one; None: there is none.

    Returns:
        Number of bytes written.

    Raises:
        RuntimeError: The viewer does not contain the placeholder for its data exactly once.
        ValueError: The exposure is not a positive number.
    """
    shell = viewer_html() if viewer is None else viewer
    if shell.count(PLACEHOLDER) != 1:
        raise RuntimeError(f"page: the viewer must contain {PLACEHOLDER} once, found {shell.count(PLACEHOLDER)}")
    if exposure is not None and not (math.isfinite(exposure) and exposure > 0):
        raise ValueError(f"page: exposure is {exposure}, expected a positive number")
    # Most of the time is compression, during which other threads run.
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        compared = list(pool.map(view_json, views))
    page = {
        "title": title,
        "exposure": exposure if exposure is None else float(exposure),
        "home": camera_json(home),
        "views": compared,
        "report": dict(report or {}),
        "links": [{"href": href, "text": text} for text, href in (links or {}).items()],
    }
    before, after = _titled(shell, title).split(PLACEHOLDER)
    # A page of one file has no decoder of KTX2, which would double its size: it shows the decoded texels.
    return write_atomically(path, (before + _scripts(without_ktx2(glb), page) + after).encode())


def viewer_html() -> str:
    """Read the viewer that is built into the package.

    Returns:
        Its HTML.

    Raises:
        RuntimeError: The installation has no built viewer.
    """
    try:
        return resources.files("lightwell").joinpath("viewer/index.html").read_text("utf-8")
    except (FileNotFoundError, ModuleNotFoundError) as error:
        raise RuntimeError(
            "page: the built viewer 'lightwell/viewer/index.html' is missing from this installation; "
            "run 'npm ci && npm run build' in web/, or install a released wheel"
        ) from error


def _titled(shell: str, title: str) -> str:
    """The viewer with its first <title> replaced."""
    element = Markup("<title>{}</title>").format(title)
    return re.sub(r"<title>[^<]*</title>", lambda _: element, shell, count=1)


def _scripts(glb: bytes, page: dict[str, Any]) -> str:
    glb = with_smaller_textures(glb)
    try:
        text = script_json(page)
    except ValueError as error:
        raise ValueError("page: its data contains NaN or infinity; find the number that is not finite") from error
    # A plain string: adding one to ``Markup`` would escape the viewer.
    return str(TEMPLATES.render("data.html", asset=_packed(glb), size=len(glb), page=Markup(text)))


def _packed(data: bytes) -> str:
    # mtime=0: the same data gives the same bytes.
    return base64.b64encode(gzip.compress(data, compresslevel=9, mtime=0)).decode()


def script_json(value: Any) -> str:
    """Write JSON that may stand inside a <script> element.

    No '<' remains in it, so neither '</script' nor '<!--' can occur.

    Args:
        value: A value of JSON types with finite numbers.

    Returns:
        The JSON text.
    """
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def camera_json(camera: Camera) -> dict[str, Any]:
    """Convert a camera to the JSON of the page.

    Args:
        camera: Camera of the scene.

    Returns:
        Position, target and up vector, and ``fov_y`` in degrees.
    """
    document = {key: value for key, value in asdict(camera).items() if key != "name"}
    return {k: float(v) if k == "fov_y" else [float(c) for c in v] for k, v in document.items()}


def view_json(view: PageView) -> dict[str, Any]:
    """Convert a view to the JSON of the page.

    Args:
        view: Held-out view.

    Returns:
        Its name, camera, light and size, and the reference as ``pack_picture`` makes it, in base64.

    Raises:
        ValueError: The reference has not 3 channels, or contains NaN or an infinity.
    """
    height, width, channels = view.reference.shape
    if channels != 3 or not np.isfinite(view.reference).all():
        raise ValueError(f"page: the reference of view '{view.name}' must be finite and have 3 channels")
    dark = dark_radiance(view.reference)
    return {
        "name": view.name,
        "camera": camera_json(view.camera),
        "light": [float(c) for c in view.light],
        **({"further": [[float(c) for c in light] for light in view.further]} if view.further else {}),
        **({} if view.pose is None else {"pose": [float(slider) for slider in view.pose]}),
        "width": width,
        "height": height,
        "dark": dark,
        "reference": base64.b64encode(pack_picture(view.reference, dark)).decode(),
    }
