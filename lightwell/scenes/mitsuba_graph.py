"""A Mitsuba XML file as a graph of nodes from which single objects are made."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.scenes.errors import SceneError


@dataclass(frozen=True)
class Node:
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
        """A parameter of the element, or ``default``."""
        return self.props[key] if self.props.has_property(key) else default


class Graph:
    """The nodes of a file, with file names made absolute and missing files replaced (with a warning)."""

    def __init__(self, path: Path, warn: Callable[[str], None]):
        self.path, self._warn = path, warn
        self._state = self._parsed()
        self._made: dict[int, Any] = {}
        self.missing: set[int] = set()
        """Nodes of shapes whose file is missing."""
        files = [self._resolve(node) for node in map(self.node, range(len(self._state.nodes)))]
        self.digest = _digest([Path(str(f)) for f in self._state.files], [f for f in files if f])

    def node(self, index: int) -> Node:
        """Node ``index``."""
        raw = self._state.nodes[index]
        plugin = raw.props.plugin_name()
        return Node(index, raw.type, plugin, raw.props.id() or f"{plugin} {index}", raw.props)

    def children(self, node: Node) -> Iterator[tuple[str, Node]]:
        """(key, child) in the order of the file."""
        for key in node.props.keys():
            if (child := self.child(node, key)) is not None:
                yield key, child

    def child(self, node: Node, key: str) -> Node | None:
        """The node that ``key`` refers to, or None."""
        value = node.get(key)
        return self.node(value.index()) if isinstance(value, mi.Properties.ResolvedReference) else None

    def child_of(self, node: Node, kind: Any) -> Node | None:
        """The first child of a kind, or None."""
        return next((child for _, child in self.children(node) if child.kind == kind), None)

    def make(self, node: Node) -> Any:
        """The Mitsuba object of a node; BSDFs and textures are made once and shared."""
        shared = node.kind in (mi.ObjectType.BSDF, mi.ObjectType.Texture)
        if node.index in self._made:
            return self._made[node.index]
        made = self.create(node, mi.Properties(node.props))
        if shared:
            self._made[node.index] = made
        return made

    def create(self, node: Node, props: Any) -> Any:
        """The Mitsuba object of a node with other parameters than its own."""
        for key, child in self.children(node):
            if props.has_property(key):
                props[key] = self.make(child)
        try:
            made = mi.PluginManager.instance().create_object(props)
            expanded = made.expand() if hasattr(made, "expand") else []
        except RuntimeError as error:
            raise SceneError(
                f"scene '{self.path.name}': '{node.name}' ({node.plugin}) cannot be made "
                f"({_one_line(error)}); correct the element"
            ) from error
        return expanded[0] if expanded else made

    def _parsed(self):
        config = mi.parser.ParserConfig(mi.variant())
        config.merge_meshes = config.merge_equivalent = False
        try:
            state = mi.parser.parse_file(config, str(self.path))
            mi.parser.transform_all(config, state)
        except (RuntimeError, UnicodeDecodeError) as error:
            raise SceneError(
                f"scene '{self.path.name}': cannot be read as a Mitsuba scene ({_one_line(error)}); correct the file"
            ) from error
        if state.nodes[0].type != mi.ObjectType.Scene:
            raise SceneError(f"scene '{self.path.name}': its root is no <scene>; give a Mitsuba 3 scene file")
        return state

    def _resolve(self, node: Node) -> Path | None:
        """Make the file name of ``node`` absolute; the file, if there is one."""
        name = node.get("filename")
        if not isinstance(name, str):
            return None
        path = self.path.parent / name
        node.props["filename"] = str(path)
        if path.is_file():
            return path
        if node.kind == mi.ObjectType.Texture:
            self._warn(f"texture '{name}' is missing; a grey one takes its place")
            node.props.remove_property("filename")
            node.props["bitmap"] = mi.Bitmap(np.full((2, 2, 3), 0.5, np.float32))
        elif node.kind == mi.ObjectType.Shape:
            self._warn(f"mesh file '{name}' is missing; the shape is left out")
            self.missing.add(node.index)
        return None


def _one_line(error: BaseException) -> str:
    """Mitsuba's message on one line."""
    return " ".join(str(error).split())[:300]


def _digest(files: list[Path], named: list[Path]) -> str:
    """SHA-256 over the scene files and every file they name."""
    total = hashlib.sha256()
    for path in dict.fromkeys([*files, *named]):
        total.update(hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b"missing")
    return total.hexdigest()
