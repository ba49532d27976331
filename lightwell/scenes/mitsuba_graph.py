"""A checked Mitsuba XML file as a graph of nodes, from which single Mitsuba objects are made."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.scenes.errors import SceneError
from lightwell.scenes.mitsuba_gate import Gated


@dataclass(frozen=True)
class MitsubaElement:
    """One element of the file."""

    index: int
    kind: Any
    """mi.ObjectType."""
    plugin: str
    name: str
    """Its id, or plugin and number."""
    props: Any
    """mi.Properties; children are references to other nodes."""

    def get(self, key: str, default: Any = None) -> Any:
        """Read a parameter.

        Args:
            key: Name of the parameter.
            default: Value when the element does not have it.

        Returns:
            Its value.
        """
        return self.props[key] if key in self.props else default


class MitsubaDocument:
    """The nodes of a file; files of missing or already decoded images are replaced by pixels."""

    def __init__(self, path: Path, gated: Gated) -> None:
        """Parse a checked document with Mitsuba.

        Args:
            path: The scene's file.
            gated: Accepted document.
        """
        self.path, self._gated = path, gated
        self._config = mi.parser.ParserConfig(mi.variant())
        self._config.merge_meshes = self._config.merge_equivalent = False
        # Mitsuba may ignore parameters that it does not use.
        self._config.unused_properties = mi.LogLevel.Debug
        self._state = self._parsed()
        self._made: dict[int, Any] = {}
        self.missing: set[int] = set()
        """Nodes of shapes whose file is missing."""
        files = [self._resolve(node) for node in map(self.node, range(len(self._state.nodes)))]
        self.digest = _digest(gated.read, [f for f in files if f])

    def node(self, index: int) -> MitsubaElement:
        """Return a node.

        Args:
            index: Number of the node.

        Returns:
            The node.
        """
        raw = self._state.nodes[index]
        plugin = raw.props.plugin_name()
        return MitsubaElement(index, raw.type, plugin, raw.props.id() or f"{plugin} {index}", raw.props)

    def children(self, node: MitsubaElement) -> Iterator[tuple[str, MitsubaElement]]:
        """Iterate over the children of a node in the order of the file.

        Args:
            node: Parent.

        Yields:
            Parameter name and child.
        """
        for key in node.props.keys():
            if (child := self.child(node, key)) is not None:
                yield key, child

    def child(self, node: MitsubaElement, key: str) -> MitsubaElement | None:
        """Return the node that a parameter refers to.

        Args:
            node: Parent.
            key: Name of the parameter.

        Returns:
            The child, or None.
        """
        value = node.get(key)
        return self.node(value.index()) if isinstance(value, mi.Properties.ResolvedReference) else None

    def child_of(self, node: MitsubaElement, kind: Any) -> MitsubaElement | None:
        """Return the first child of a kind.

        Args:
            node: Parent.
            kind: An ``mi.ObjectType``.

        Returns:
            The child, or None.
        """
        return next((child for _, child in self.children(node) if child.kind == kind), None)

    def make(self, node: MitsubaElement) -> Any:
        """Make the Mitsuba object of a node; BSDFs and textures are made once and shared.

        Args:
            node: Node to make.

        Returns:
            The Mitsuba object.
        """
        shared = node.kind in (mi.ObjectType.BSDF, mi.ObjectType.Texture)
        if node.index in self._made:
            return self._made[node.index]
        made = self.create(node, mi.Properties(node.props))
        if shared:
            self._made[node.index] = made
        return made

    def create(self, node: MitsubaElement, props: Any) -> Any:
        """Make the Mitsuba object of a node with changed parameters.

        Args:
            node: Node to make.
            props: ``mi.Properties`` to use instead of its own.

        Returns:
            The Mitsuba object.

        Raises:
            SceneError: Mitsuba cannot make the object.
        """
        for key, child in self.children(node):
            if key in props:
                props[key] = self.make(child)
        try:
            made = mi.PluginManager.instance().create_object(props)
            expanded = made.expand() if hasattr(made, "expand") else []
        except (RuntimeError, UnicodeDecodeError) as error:
            raise SceneError(
                f"scene '{self.path.name}': '{node.name}' ({node.plugin}) cannot be made "
                f"({self._one_line(error)}); correct the element"
            ) from error
        return expanded[0] if expanded else made

    def whole(self) -> Any:
        """Make the Mitsuba scene of the whole file, with its media.

        Returns:
            ``mi.Scene``.

        Raises:
            SceneError: Mitsuba cannot make the scene.
        """
        try:
            return mi.parser.instantiate(self._config, mi.parser.ParserState(self._state))
        except RuntimeError as error:
            raise SceneError(
                f"scene '{self.path.name}': cannot be made with its media ({self._one_line(error)}); correct the file"
            ) from error

    def _parsed(self) -> Any:
        try:
            state = mi.parser.parse_string(self._config, self._gated.text)
            mi.parser.transform_all(self._config, state)
        except (RuntimeError, UnicodeDecodeError) as error:
            raise SceneError(
                f"scene '{self.path.name}': cannot be read as a Mitsuba scene ({self._one_line(error)}); "
                "correct the file"
            ) from error
        return state

    def _resolve(self, node: MitsubaElement) -> Path | None:
        """Set a node's pixels where Mitsuba must not open the file; returns the file, if there is one."""
        name, files = node.get("filename"), self._gated.files
        if not isinstance(name, str):
            return None
        if name in files.missing:
            if node.kind == mi.ObjectType.Shape:
                self.missing.add(node.index)
            elif node.kind == mi.ObjectType.Texture:
                del node.props["filename"]
                node.props["bitmap"] = mi.Bitmap(np.full((2, 2, 3), 0.5, np.float32))
            return None
        if name in files.pictures:
            pixels, srgb = files.pictures[name]
            picture = mi.Bitmap(pixels)
            picture.set_srgb_gamma(srgb)
            del node.props["filename"]
            node.props["bitmap"] = picture
        return Path(name)

    def _one_line(self, error: BaseException) -> str:
        """Write Mitsuba's message on one line, with line numbers of the author's files."""

        def place(found: re.Match[str]) -> str:
            number = int(found[1])
            if not 1 <= number <= len(self._gated.places):
                return found[0]
            element = self._gated.places[number - 1]
            return f"{element.file}, line {element.line}"

        text = re.sub(r"(?:string \()?line (\d+), col \d+\)?", place, " ".join(str(error).split()))
        return text[:300]


def _digest(files: list[Path], named: list[Path]) -> str:
    """Compute the SHA-256 of the scene files and every file they name."""
    total = hashlib.sha256()
    for path in dict.fromkeys([*files, *named]):
        total.update(hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b"missing")
    return total.hexdigest()
