"""A Mitsuba XML file and its includes as one tree of elements, read without Mitsuba.

This module hands nothing of the file to Mitsuba: ``mitsuba_gate`` checks the tree, and ``written`` writes the accepted
elements as a new document, one element per line, with parameters replaced and includes inserted.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from lightwell.limits import LoadBudget
from lightwell.scenes.errors import SceneError
from lightwell.scenes.mitsuba_paths import Folders

# Levels of elements, and of includes (Mitsuba's own limit); included files in all.
MOST_DEPTH, MOST_INCLUDE_DEPTH, MOST_INCLUDES = 64, 15, 1000
# A use of a parameter, and the longest name of one.
PARAMETER, MOST_NAME = re.compile(r"(?<!\\)\$(\w+)"), 100
# Bytes of one XML file, and characters of one value and of all together after parameters are replaced.
MOST_BYTES, MOST_VALUE, MOST_TEXT = 1 << 27, 1 << 20, 1 << 28
# XML forbids '--' in comments, but authors write it and Mitsuba reads it.
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
Version = tuple[int, ...]


@dataclass(slots=True)
class Element:
    """One XML element of the file."""

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    children: list[Element] = field(default_factory=list)

    @property
    def type(self) -> str:
        """Name of its Mitsuba plug-in."""
        return self.attributes.get("type", "")

    @property
    def place(self) -> str:
        """File and line, the beginning of messages about it."""
        return f"scene '{self.file}': line {self.line}"

    def value(self, name: str) -> str | None:
        """Find the value of a property.

        Args:
            name: Name of the property.

        Returns:
            Its value, or None.
        """
        for child in self.children:
            if child.attributes.get("name") == name and "value" in child.attributes:
                return child.attributes["value"]
        return None

    def fail(self, text: str) -> SceneError:
        """Make the error that names this element.

        Args:
            text: Problem and cure.

        Returns:
            The error, to be raised.
        """
        return SceneError(f"{self.place}: {text}")


@dataclass
class Document:
    """The tree of a scene and the files that it was read from."""

    root: Element
    files: list[Path]


Upgrade = Callable[[Element, Version], list[Element]]


def read_document(path: Path, folders: Folders, budget: LoadBudget, upgrade: Upgrade) -> Document:
    """Read a file: includes inserted, parameters replaced, upgraded to Mitsuba 3.

    Args:
        path: The scene's file.
        folders: Folders of included files.
        budget: Counts elements and bytes.
        upgrade: Called for every element, after its children, with the version of its file; returns its replacement.

    Returns:
        The tree and the files that were read.

    Raises:
        SceneError: The root is no <scene>.
    """
    reader = _Reader(folders, budget, upgrade)
    root = reader.file(path, path.name, [])
    if root.tag != "scene":
        raise SceneError(f"scene '{path.name}': its root is no <scene>; give a Mitsuba scene file")
    return Document(root, reader.files)


class _Reader:
    def __init__(self, folders: Folders, budget: LoadBudget, upgrade: Upgrade):
        self._folders, self._budget, self._upgrade = folders, budget, upgrade
        self.files: list[Path] = []
        self._parameters: dict[str, str] = {}
        self._text = 0

    def file(self, path: Path, name: str, above: list[Path], depth: int = 0) -> Element:
        """Read the root of a file; ``above``: the files that include it."""
        self.files.append(path)
        root = parse(path, name, self._budget)
        version = _version(root)
        # A root that another file replaces, or that is left out, is no root.
        done = self._expanded(root, path, above, version, depth)
        return done[0] if len(done) == 1 else root

    def _expanded(self, element: Element, path: Path, above: list[Path], version: Version, depth: int) -> list[Element]:
        """Return the replacement of an element."""
        if depth > MOST_DEPTH:
            raise element.fail(f"elements are nested deeper than {MOST_DEPTH} levels; flatten the scene")
        self._replace_parameters(element)
        if element.tag == "default":
            self._define(element)
            return []
        if element.tag == "path":
            self._folders.add(element.attributes.get("value", ""), element.place)
            return []
        if element.tag == "include":
            return self._include(element, path, above, depth)
        element.children = [
            made for child in element.children for made in self._expanded(child, path, above, version, depth + 1)
        ]
        return self._upgrade(element, version)

    def _include(self, element: Element, path: Path, above: list[Path], depth: int) -> list[Element]:
        name = element.attributes.get("filename", "")
        found = self._folders.find(name, element.place, first=path.parent)
        if found is None:
            raise element.fail(f"the included file '{name[:120]}' does not exist; correct the name")
        chain = [*above, path]
        if found in [Path(p).resolve() for p in chain]:
            raise element.fail(f"'{name[:120]}' includes itself; take the <include> out")
        if len(chain) >= MOST_INCLUDE_DEPTH or len(self.files) >= MOST_INCLUDES:
            raise element.fail(
                f"includes are nested deeper than {MOST_INCLUDE_DEPTH} files or more than {MOST_INCLUDES}; merge them"
            )
        root = self.file(found, name, chain, depth)
        if root.tag == "scene":
            return root.children
        root.attributes.pop("version", None)
        if "name" in element.attributes:
            root.attributes["name"] = element.attributes["name"]
        return [root]

    def _define(self, element: Element) -> None:
        """Store a parameter's default, unless it has one."""
        name = element.attributes.get("name", "")
        if len(name) > MOST_NAME or not re.fullmatch(r"\w+", name):
            raise element.fail(
                f"<default> has the name '{name[:60]}', expected up to {MOST_NAME} letters and digits; correct it"
            )
        self._parameters.setdefault(name, element.attributes.get("value", ""))

    def _replace_parameters(self, element: Element) -> None:
        for key, value in element.attributes.items():
            if "$" in value:
                value = self._replaced(element, key, value)
                if unknown := re.search(r"(?<!\\)\$\w*", value):
                    raise element.fail(f"undefined parameter {unknown[0][:60]}; add a <default> for it above")
                element.attributes[key] = value = value.replace("\\$", "$")
            self._text += len(value)
            if len(value) > MOST_VALUE or self._text > MOST_TEXT:
                raise _too_long(element, key)

    def _replaced(self, element: Element, key: str, value: str) -> str:
        """Replace the parameters of a value; unknown ones stay."""
        parts, end, size = [], 0, 0
        for found in PARAMETER.finditer(value):
            parts += [value[end : found.start()], self._parameter(found)]
            end, size = found.end(), size + len(parts[-2]) + len(parts[-1])
            if size > MOST_VALUE:
                raise _too_long(element, key)
        return "".join([*parts, value[end:]])

    def _parameter(self, found: re.Match[str]) -> str:
        """The value of the longest parameter that a word begins with, and the rest of the word."""
        word = found[1]
        for length in range(min(len(word), MOST_NAME), 0, -1):
            if word[:length] in self._parameters:
                return self._parameters[word[:length]] + word[length:]
        return found[0]


def _too_long(element: Element, key: str) -> SceneError:
    return element.fail(f"'{key[:60]}' is too long (over {MOST_VALUE} characters, or {MOST_TEXT} in all); shorten it")


def parse(path: Path, name: str, budget: LoadBudget) -> Element:
    """Read the tree of one XML file without changes.

    Args:
        path: File to read.
        name: Name of the file in messages.
        budget: Counts elements and bytes.

    Returns:
        The root element.

    Raises:
        SceneError: The file is not well-formed, or is too large.
    """
    data = _bytes(path, name, budget)
    builder = _Builder(name, budget)
    parser = builder.parser
    try:
        parser.Parse(_COMMENT.sub(lambda found: b"\n" * found[0].count(b"\n"), data), True)
    except SceneError:
        raise
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise SceneError(
            f"scene '{name}': cannot be read as a Mitsuba scene ({' '.join(str(error).split())[:200]}); "
            "correct the file"
        ) from None
    assert builder.root is not None
    return builder.root


def _bytes(path: Path, name: str, budget: LoadBudget) -> bytes:
    try:
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise SceneError(f"scene '{name}': is {size} bytes of XML, more than {MOST_BYTES}; move meshes into files")
        budget.charge("file_bytes", size, name)
        return path.read_bytes()
    except OSError as error:
        raise SceneError(f"scene '{name}': cannot be read ({error.strerror}); check the file") from None


class _Builder:
    """Collects the elements that the parser finds."""

    def __init__(self, name: str, budget: LoadBudget):
        self._name, self._budget = name, budget
        self._open: list[Element] = []
        self.root: Element | None = None
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = lambda _: self._open.pop()
        self.parser.StartDoctypeDeclHandler = self._doctype

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, self._name, self.parser.CurrentLineNumber)
        if len(self._open) >= MOST_DEPTH:
            raise element.fail(f"elements are nested deeper than {MOST_DEPTH} levels; flatten the scene")
        self._budget.charge("nodes", 1, f"line {element.line}")
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _doctype(self, *_: object) -> None:
        raise SceneError(
            f"scene '{self._name}': line {self.parser.CurrentLineNumber}: has a DOCTYPE, which can name entities; "
            "take it out, Mitsuba scenes need none"
        )


def _version(root: Element) -> Version:
    text = root.attributes.get("version", "")
    if not re.fullmatch(r"\d{1,4}(\.\d{1,4}){0,3}", text.strip()):
        raise root.fail(f"its version is '{text[:40]}', expected three numbers; write <{root.tag} version=\"3.0.0\">")
    return tuple(int(part) for part in text.strip().split("."))


def written(document: Document) -> tuple[str, list[Element]]:
    """Write a document as text for Mitsuba.

    Args:
        document: Accepted document.

    Returns:
        The text, and the element on each of its lines.
    """
    document.root.attributes["version"] = "3.0.0"
    lines = list(_lines(document.root))
    return "\n".join(text for text, _ in lines), [element for _, element in lines]


def _lines(element: Element) -> Iterator[tuple[str, Element]]:
    # A dollar sign would begin another parameter.
    attributes = "".join(f" {k}={quoteattr(v.replace('$', chr(92) + '$'))}" for k, v in element.attributes.items())
    if not element.children:
        yield f"<{element.tag}{attributes}/>", element
        return
    yield f"<{element.tag}{attributes}>", element
    for child in element.children:
        yield from _lines(child)
    yield f"</{element.tag}>", element
