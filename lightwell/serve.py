"""Serves a baked folder on the loopback interface, and nothing else."""

from __future__ import annotations

import functools
import http.server
import webbrowser
from pathlib import Path

LOOPBACK = "127.0.0.1"


class _Handler(http.server.SimpleHTTPRequestHandler):
    """Files of one folder; no directory listings, no caching, quiet."""

    extensions_map = {  # noqa: RUF012  (the base class's own attribute)
        **http.server.SimpleHTTPRequestHandler.extensions_map,
        ".glb": "model/gltf-binary",
        ".json": "application/json",
    }

    def end_headers(self) -> None:
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        super().end_headers()

    def translate_path(self, path: str) -> str:
        """Keep hidden files (the bake's work folder) private."""
        translated = super().translate_path(path)
        hidden = any(part.startswith(".") for part in Path(translated).relative_to(self.directory).parts)
        return str(Path(self.directory) / "not found") if hidden else translated

    def list_directory(self, path):
        self.send_error(404, "no listing")

    def log_message(self, format: str, *args) -> None:
        pass


def checked_folder(out: str) -> Path:
    """The folder of a bake; ValueError in one line when it is not one."""
    folder = Path(out)
    if not (folder / "index.html").is_file():
        raise ValueError(f"view: '{out}' has no index.html; name a folder that 'lightwell bake … -o {out}' has written")
    return folder


def open_server(folder: Path, port: int = 0) -> http.server.ThreadingHTTPServer:
    """A server of ``folder`` on 127.0.0.1; port 0 takes any free one."""
    handler = functools.partial(_Handler, directory=str(folder.resolve()))
    try:
        return http.server.ThreadingHTTPServer((LOOPBACK, port), handler)
    except OSError as error:
        raise ValueError(
            f"view: port {port} cannot be opened ({error.strerror}); choose another with --port"
        ) from error


def view(out: str, port: int = 0, browser: bool = True) -> None:
    """Serve until interrupted; open the page in the default browser when there is one."""
    server = open_server(checked_folder(out), port)
    url = f"http://{LOOPBACK}:{server.server_address[1]}/"
    print(f"{url}  (Ctrl-C ends)", flush=True)
    if browser:
        webbrowser.open(url)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        pass
    finally:
        server.server_close()
