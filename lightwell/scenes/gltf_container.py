"""The container of a glTF file: GLB chunks, the JSON document, buffers and external files."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import struct
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

from lightwell.limits import JSON_EXPANSION, Limits
from lightwell.scenes.errors import SceneError
from lightwell.scenes.gltf_json import CURE, Place

GLB_MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
HEADER_BYTES, CHUNK_HEADER_BYTES = 12, 8


class Document:
    """An opened glTF file: its JSON root, its lists and its bytes. A defect raises ``SceneError``."""

    def __init__(self, path: Path, limits: Limits) -> None:
        """Open a file and parse its JSON.

        Args:
            path: The file.
            limits: Limits on sizes and counts.
        """
        self.path = path
        self.scene = path.name
        self.budget = limits.budget(f"scene '{self.scene}'", SceneError)
        self._digests: dict[Path, str] = {}
        data = self._read(path)
        json_bytes, self._binary = self._split(data)
        self.root = Place(self.scene, "the glTF document", self._parse(json_bytes))
        self._buffers: dict[int, memoryview] = {}
        self._files: dict[Path, bytes] = {}
        self._check_version()

    @property
    def digests(self) -> dict[Path, str]:
        """SHA-256 of the file and of every external file that was read, in the order of reading."""
        return dict(self._digests)

    @property
    def digest(self) -> str:
        """SHA-256 of the file, or of the digests of all files that were read."""
        first, *more = self._digests.values()
        return hashlib.sha256("".join([first, *more]).encode()).hexdigest() if more else first

    def count(self, key: str) -> int:
        """Return the length of a top-level list.

        Args:
            key: Name of the list, such as 'accessors'.

        Returns:
            Its length; 0 when it is missing.
        """
        return len(self.root.items(key))

    def item(self, key: str, index: int) -> Place:
        """Return an entry of a top-level list, named for instance ``accessor 7`` in messages.

        Args:
            key: Name of the list, such as 'accessors'.
            index: Number of the entry.

        Returns:
            The entry.
        """
        what = "mesh" if key == "meshes" else key[:-1]
        values = self.root.items(key)
        if not 0 <= index < len(values):
            self.fail(f"{what} {index} is named, but there are {len(values)}")
        return Place(self.scene, f"{what} {index}", values[index])

    def fail(self, problem: str, cure: str = CURE) -> NoReturn:
        """Raise an error about the file.

        Args:
            problem: What is wrong.
            cure: What the user can do.

        Raises:
            SceneError: Always.
        """
        raise SceneError(f"scene '{self.scene}': {problem}; {cure}")

    def buffer(self, index: int) -> memoryview:
        """Return the bytes of a buffer.

        Args:
            index: Number of the buffer.

        Returns:
            Its bytes.
        """
        if index not in self._buffers:
            place = self.item("buffers", index)
            length = place.integer("byteLength", low=1)
            if "uri" in place:
                data = self.resource(place, place.text("uri"))
            elif index == 0 and self._binary is not None:
                data = self._binary
            else:
                place.fail("has neither a uri nor a binary chunk in this file")
            if len(data) < length:
                place.fail(f"has {len(data)} bytes, but says {length}")
            # A view: several buffers may be parts of one file.
            self._buffers[index] = memoryview(data)[:length]
        return self._buffers[index]

    def resource(self, place: Place, uri: str) -> bytes:
        """Read a data URI, or a file in the folder of the glTF file or below it.

        Args:
            place: Element that names it.
            uri: The URI.

        Returns:
            Its bytes.
        """
        if uri.startswith("data:"):
            return self._data_uri(place, uri)
        if "://" in uri or uri.startswith("file:"):
            place.fail(f"names '{uri[:60]}'", "only files beside the glTF file are read; download it and export again")
        folder = self.path.parent.resolve()
        try:
            target = (folder / unquote(uri)).resolve()
            if not target.is_file():
                # Exporters for Windows write backslashes, which browsers read as slashes.
                other = (folder / unquote(uri).replace("\\", "/")).resolve()
                target = other if other.is_relative_to(folder) and other.is_file() else target
            inside, exists = target.is_relative_to(folder), target.is_file()
        except (OSError, ValueError):
            place.fail(f"names the unusable path '{uri[:60]!r}'")
        if not inside:
            place.fail(f"names '{uri[:60]}' outside the folder of the file", "move it beside the file and export again")
        if not exists:
            place.fail(f"names the file '{uri[:60]}', which is missing", "put it beside the glTF file")
        if target not in self._files:
            self._files[target] = self._read(target)
        return self._files[target]

    def _read(self, path: Path) -> bytes:
        try:
            self.budget.charge("file_bytes", path.stat().st_size, f"file '{path.name}'")
            data = path.read_bytes()
        except OSError as error:
            reason = error.strerror or error
            raise SceneError(f"scene '{self.scene}': cannot read '{path}' ({reason}); check the path") from error
        self._digests[path] = hashlib.sha256(data).hexdigest()
        return data

    def _data_uri(self, place: Place, uri: str) -> bytes:
        head, comma, body = uri.partition(",")
        if not comma:
            place.fail("has a data URI without a comma")
        try:
            if head.endswith(";base64"):
                return base64.b64decode(unquote(body), validate=True)
            return unquote(body, encoding="latin-1").encode("latin-1")
        except (binascii.Error, ValueError):
            place.fail("has a data URI that is not valid base64")

    def _split(self, data: bytes) -> tuple[bytes, bytes | None]:
        """Split a file into JSON bytes and the binary chunk, if any."""
        if len(data) < 4 or struct.unpack_from("<I", data)[0] != GLB_MAGIC:
            if self.path.suffix.lower() == ".glb":
                self.fail("does not begin with 'glTF', so it is no GLB file")
            return data, None
        if len(data) < HEADER_BYTES + CHUNK_HEADER_BYTES:
            self.fail(f"has {len(data)} bytes, too few for a GLB header")
        _, version, length = struct.unpack_from("<III", data)
        if version != 2:
            self.fail(f"is GLB version {version}, expected 2", "convert it to glTF 2.0")
        if length > len(data):
            self.fail(f"has {len(data)} bytes, but its header says {length}")
        return self._chunks(data[:length])

    def _chunks(self, data: bytes) -> tuple[bytes, bytes | None]:
        chunks: list[tuple[int, bytes]] = []
        offset = HEADER_BYTES
        while offset + CHUNK_HEADER_BYTES <= len(data):
            length, kind = struct.unpack_from("<II", data, offset)
            offset += CHUNK_HEADER_BYTES
            if offset + length > len(data):
                self.fail(f"chunk {len(chunks)} reads bytes {offset}..{offset + length} of a file of {len(data)}")
            chunks.append((kind, data[offset : offset + length]))
            offset += length
        if not chunks or chunks[0][0] != JSON_CHUNK:
            self.fail("its first GLB chunk is not JSON")
        binary = next((bytes_ for kind, bytes_ in chunks[1:] if kind == BINARY_CHUNK), None)
        return chunks[0][1], binary

    def _parse(self, data: bytes) -> Any:
        self.budget.charge("decoded_bytes", JSON_EXPANSION * len(data), "its JSON")
        try:
            return json.loads(data.decode("utf-8-sig"))
        except (ValueError, RecursionError) as error:
            reason = str(error).splitlines()[0]
            raise SceneError(f"scene '{self.scene}': its JSON cannot be read ({reason}); {CURE}") from error

    def _check_version(self) -> None:
        version = self.root.need("asset").text("version")
        if version.split(".")[0] != "2":
            self.fail(f"is glTF version '{version[:10]}', expected 2.0", "convert it to glTF 2.0")
