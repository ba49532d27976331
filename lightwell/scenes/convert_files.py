"""What a converted scene may read: files inside the folder of the scene, pictures of known kinds."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

# Beginnings of the files that glTF may hold.
SIGNATURES = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg"}
# Formats of pictures that are converted to PNG.
FORMATS = ("PNG", "JPEG", "BMP", "TGA", "WEBP", "TIFF")


def as_png(image: Any) -> tuple[bytes, str] | None:
    """Encode a picture that Pillow has opened.

    Args:
        image: ``PIL.Image.Image``; its format is one of ``FORMATS``.

    Returns:
        Bytes of a PNG and its media type; None where it cannot be decoded or is of another format.
    """
    if image.format not in FORMATS:
        return None
    out = io.BytesIO()
    try:
        image.convert("RGBA" if image.has_transparency_data else "RGB").save(out, "PNG")
    except (OSError, ValueError, SyntaxError):
        return None
    return out.getvalue(), "image/png"


class Folder(Mapping[str, bytes]):
    """The files of a folder by relative name; names that leave the folder are missing."""

    def __init__(self, path: Path, most_bytes: int) -> None:
        """Take a folder.

        Args:
            path: The folder.
            most_bytes: Bytes that may be read from it in all.
        """
        self._path, self._left = path.resolve(), most_bytes
        self._read: dict[str, bytes] = {}
        self.missing: set[str] = set()
        """Names that were asked for and not found in the folder."""

    def __getitem__(self, name: str) -> bytes:
        if name not in self._read:
            path = (self._path / str(name).replace("\\", "/")).resolve()
            if not path.is_relative_to(self._path) or not path.is_file():
                self.missing.add(str(name))
                raise KeyError(name)
            size = path.stat().st_size
            if size > self._left:
                raise ValueError(f"reads more than its limit of bytes at '{path.name}'; use --limit file_bytes=NUMBER")
            self._left -= size
            self._read[name] = path.read_bytes()
        return self._read[name]

    def __contains__(self, name: object) -> bool:
        try:
            self[str(name)]
        except (KeyError, OSError):
            return False
        return True

    def __iter__(self) -> Iterator[str]:
        return iter(self._read)

    def __len__(self) -> int:
        return len(self._read)

    def picture(self, name: str) -> tuple[bytes, str] | None:
        """Read a picture.

        Args:
            name: Its relative name.

        Returns:
            Its bytes and media type; None where it is missing or neither PNG nor JPEG.
        """
        data = self[name] if name in self else b""
        kind = next((mime for start, mime in SIGNATURES.items() if data.startswith(start)), None)
        return None if kind is None else (data, kind)
