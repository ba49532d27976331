"""What a converted scene may read: files inside the folder of the scene, pictures of known kinds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

# Beginnings of the files that glTF may hold.
SIGNATURES = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg"}


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

    def __getitem__(self, name: str) -> bytes:
        if name not in self._read:
            path = (self._path / str(name).replace("\\", "/")).resolve()
            if not path.is_relative_to(self._path) or not path.is_file():
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
