"""``lightwell view``: serve a baked folder on the loopback interface."""

from __future__ import annotations

import re
import webbrowser
from pathlib import Path
from urllib.parse import quote

from lightwell.serving.server import Answer, Application, LocalServer, Request, wait_for_interrupt

# MIME types of what bakes and exports write; not the machine's own table, which differs.
TYPES = {
    ".html": "text/html; charset=utf-8", ".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8", ".json": "application/json", ".md": "text/markdown; charset=utf-8",
    ".txt": "text/plain; charset=utf-8", ".glsl": "text/plain; charset=utf-8", ".wgsl": "text/plain; charset=utf-8",
    ".csv": "text/csv; charset=utf-8", ".svg": "image/svg+xml", ".png": "image/png", ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg", ".webp": "image/webp", ".ktx2": "image/ktx2", ".hdr": "image/vnd.radiance",
    ".exr": "image/x-exr", ".glb": "model/gltf-binary", ".gltf": "model/gltf+json", ".wasm": "application/wasm",
}  # fmt: skip
OTHER_TYPE = "application/octet-stream"
# One range of bytes; several at once are answered with the whole file, as RFC 9110 allows.
RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})")


def checked_folder(out: str) -> Path:
    """Check that a folder holds a bake.

    Args:
        out: Output folder of a bake.

    Returns:
        The folder.

    Raises:
        ValueError: The folder has no ``index.html``; one line.
    """
    folder = Path(out)
    if not (folder / "index.html").is_file():
        raise ValueError(f"view: '{out}' has no index.html; name a folder that 'lightwell bake … -o {out}' has written")
    return folder


def open_server(folder: Path, port: int = 0) -> LocalServer:
    """Serve a folder on 127.0.0.1. A port that cannot be opened raises ``ValueError``.

    Args:
        folder: Folder to serve.
        port: Port, 0 to 65535; 0 takes any free one.

    Returns:
        The running server; close it, or use it as a context manager.
    """
    return LocalServer(files_of(folder), port, "view")


def view(out: str, port: int = 0, browser: bool = True) -> None:
    """Serve a baked folder until Ctrl-C, which raises ``KeyboardInterrupt``.

    A folder without a bake, or a port that cannot be opened, raises ``ValueError``.

    Args:
        out: Output folder of a bake.
        port: Port, 0 to 65535; 0 takes any free one.
        browser: Open the page in the default browser when there is one.
    """
    with open_server(checked_folder(out), port) as server:
        print(f"{server.url}  (Ctrl-C ends)", flush=True)
        if browser:
            webbrowser.open(server.url)
        wait_for_interrupt()


def files_of(folder: Path) -> Application:
    """Make an application that serves the files of a folder: no hidden files, listings, or links out of the folder.

    Args:
        folder: Folder to serve.

    Returns:
        The application; it answers GET and HEAD.
    """
    root = folder.resolve()

    def answer(request: Request) -> Answer:
        if request.method not in ("GET", "HEAD"):
            return Answer(405, headers=(("Allow", "GET, HEAD"),))
        start, *parts = request.path.split("/")
        if start or not parts or any(part.startswith(".") or set(part) & set("\0\\:") for part in parts):
            return _nothing()
        target = root.joinpath(*parts)
        try:
            if parts[-1] and (target / "index.html").is_file():
                return Answer(301, headers=(("Location", quote("/" + "/".join(p for p in parts if p) + "/")),))
            found = (target if parts[-1] else target / "index.html").resolve(strict=True)
            if not found.is_file() or any(part.startswith(".") for part in found.relative_to(root).parts):
                return _nothing()
            return _file(found, request.byte_range)
        except (OSError, ValueError, RuntimeError):
            # Missing, a name that the system does not take, a link out of the folder, or a circle of links.
            return _nothing()

    return answer


def _nothing() -> Answer:
    return Answer.of(404, b"there is nothing here")


def _file(path: Path, asked: str) -> Answer:
    """Return the answer with a file, or with the requested byte range of it."""
    kind = TYPES.get(path.suffix.lower(), OTHER_TYPE)
    if kind.startswith("text/html"):
        return Answer.page(path.read_bytes())
    size = path.stat().st_size
    wanted = parse_range(asked, size)
    headers: tuple[tuple[str, str], ...] = (("Accept-Ranges", "bytes"),)
    if wanted is None:
        return Answer(200, kind, open(path, "rb"), size, headers)
    first, last = wanted
    if first > last:
        return Answer(416, headers=(("Content-Range", f"bytes */{size}"),))
    body = open(path, "rb")
    body.seek(first)
    headers += (("Content-Range", f"bytes {first}-{last}/{size}"),)
    return Answer(206, kind, body, last - first + 1, headers)


def parse_range(asked: str, size: int) -> tuple[int, int] | None:
    """Parse the HTTP header Range for a file.

    Args:
        asked: Value of the header; empty for none.
        size: Length of the file, bytes.

    Returns:
        First and last byte; None where the whole file is to be sent; a first byte after the last where the range lies
        outside the file.
    """
    match = RANGE.fullmatch(asked.strip())
    first, last = match.groups() if match else ("", "")
    if first:
        end = int(last) if last else size - 1
        return (int(first), min(end, size - 1)) if not last or int(first) <= end else None
    return (size - min(int(last), size), size - 1) if last else None
