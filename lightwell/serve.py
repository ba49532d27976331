"""Serves a baked folder on the loopback interface, and nothing else."""

from __future__ import annotations

import re
import webbrowser
from pathlib import Path
from urllib.parse import quote

from lightwell.local_server import Answer, Application, LocalServer, Request, wait_for_interrupt

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
    """The folder of a bake; ValueError in one line when it is not one."""
    folder = Path(out)
    if not (folder / "index.html").is_file():
        raise ValueError(f"view: '{out}' has no index.html; name a folder that 'lightwell bake … -o {out}' has written")
    return folder


def open_server(folder: Path, port: int = 0) -> LocalServer:
    """Serve ``folder`` on 127.0.0.1; port 0 takes any free one.

    Raises:
        ValueError: The port cannot be opened.
    """
    return LocalServer(files_of(folder), port, "view")


def view(out: str, port: int = 0, browser: bool = True) -> None:
    """Serve until interrupted; open the page in the default browser when there is one.

    Raises:
        KeyboardInterrupt: The user pressed Ctrl-C; there is no other end.
        ValueError: ``out`` is no folder of a bake, or the port cannot be opened.
    """
    with open_server(checked_folder(out), port) as server:
        print(f"{server.url}  (Ctrl-C ends)", flush=True)
        if browser:
            webbrowser.open(server.url)
        wait_for_interrupt()


def files_of(folder: Path) -> Application:
    """The application that answers with the files of a folder: no hidden ones, no listings, no links out of it."""
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
    """The answer with a file, or with the range of it that is asked for."""
    kind = TYPES.get(path.suffix.lower(), OTHER_TYPE)
    if kind.startswith("text/html"):
        return Answer.page(path.read_bytes())
    size = path.stat().st_size
    wanted = parse_range(asked, size)
    headers = (("Accept-Ranges", "bytes"),)
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
    """First and last byte that a header Range asks for of ``size`` bytes.

    Returns:
        None where the whole file is to be sent; a first byte after the last where the range lies outside the file.
    """
    match = RANGE.fullmatch(asked.strip())
    first, last = match.groups() if match else ("", "")
    if first:
        end = int(last) if last else size - 1
        return (int(first), min(end, size - 1)) if not last or int(first) <= end else None
    return (size - min(int(last), size), size - 1) if last else None
