"""Checks of a Mitsuba file before Mitsuba reads it: the file as a tree is checked, and only accepted elements are
passed on.

Plug-ins must be on a list, files inside the scene's folder and of the kind that their element expects, numbers finite;
references must end, and nesting and repetition are bounded. Integrators, films, samplers and filters are checked and
then replaced by plain ones, because they are not used.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from lightwell.limits import LoadBudget
from lightwell.scenes.mitsuba_document import MOST_DEPTH, Element, read_document, written
from lightwell.scenes.mitsuba_files import Files
from lightwell.scenes.mitsuba_paths import Folders
from lightwell.scenes.mitsuba_plugins import FILES, NAME, NEEDS, NO_TRIANGLES, PLUGINS, UNUSED
from lightwell.scenes.mitsuba_upgrade import Upgrade

# Elements whose values are numbers.
NUMBERS = frozenset("float integer point vector rgb spectrum matrix lookat translate rotate scale".split())
PROPERTIES = NUMBERS | frozenset("boolean string transform ref alias".split())
# Numbers beyond it are not finite in single precision.
MOST = 3.4e38
# Objects that one BSDF, emitter, texture, medium or sensor may expand to, following references.
MOST_PARTS = 1000
# Mitsuba makes file names from the names of conductors.
MATERIAL = re.compile(r"[A-Za-z0-9_-]{1,40}")


@dataclass
class Gated:
    """The accepted document."""

    text: str
    """The document for Mitsuba."""
    places: list[Element]
    """The element on each line of ``text``."""
    files: Files
    """Files that the document names."""
    read: list[Path]
    """The XML files."""


def gate(path: Path, allowed: Sequence[str | PathLike[str]], budget: LoadBudget, warn: Callable[[str], None]) -> Gated:
    """Check a Mitsuba scene before Mitsuba reads any of it; a defect raises ``SceneError`` with file, line and cure.

    Args:
        path: The scene's file.
        allowed: Further folders whose files it may name, besides its own.
        budget: Counts elements, bytes and texels.
        warn: Called with each element that is ignored or replaced.

    Returns:
        The accepted document.
    """
    folders = Folders(path.parent, allowed)
    document = read_document(path, folders, budget, Upgrade(warn))
    files = Files(folders, budget, warn)
    try:
        _Checker(document.root, files, budget, warn).check()
    finally:
        files.close()
    return Gated(*written(document), files, document.files)


class _Checker:
    def __init__(self, root: Element, files: Files, budget: LoadBudget, warn: Callable[[str], None]):
        self._root, self._files, self._budget, self._warn = root, files, budget, warn
        self._named: dict[str, Element] = {}

    def check(self) -> None:
        """Check and clean the whole tree."""
        for element in self._root.children:
            self._element(element, "scene")
        self._drop(self._root)
        for element in _all(self._root):
            self._name(element)
        self._references()

    def _element(self, element: Element, parent: str) -> None:
        tag = element.tag
        if tag in PLUGINS and (tag != "spectrum" or "type" in element.attributes):
            self._object(element)
        elif tag in PROPERTIES:
            self._property(element)
        else:
            raise element.fail(f"encountered an unsupported XML element: <{tag[:60]}> in <{parent}>; take it out")

    def _object(self, element: Element) -> None:
        tag, plugin = element.tag, element.type
        if not NAME.fullmatch(plugin) or plugin not in PLUGINS[tag]:
            known = ", ".join(sorted(PLUGINS[tag]))
            raise element.fail(f"<{tag}> has the type '{plugin[:60]}', which a scene may not name; use one of {known}")
        if tag in UNUSED:
            self._unused(element)
        for child in element.children:
            self._element(child, tag)
        self._drop(element)
        kind = FILES.get((tag, plugin))
        if kind is not None:
            self._file(element, kind)
        elif plugin not in NO_TRIANGLES:
            # What reads no file names none: a name would be taken for a file that was checked.
            element.children = [c for c in element.children if c.attributes.get("name") != "filename"]
        if (material := element.value("material")) is not None and not MATERIAL.fullmatch(material):
            raise element.fail(f"has the material '{material[:60]}', expected a name such as 'Au'; correct it")

    def _unused(self, element: Element) -> None:
        """Keep the size of a film; drop what is not used."""
        for child in element.children:
            self._element(child, element.tag)
        kept = []
        if element.tag == "film":
            kept = [
                c for c in element.children if c.tag == "integer" and c.attributes.get("name") in ("width", "height")
            ]
            self._film(element, kept)
        element.attributes["type"], element.children = UNUSED[element.tag], kept

    def _film(self, film: Element, sizes: list[Element]) -> None:
        size = {}
        for child in sizes:
            try:
                size[child.attributes["name"]] = int(child.attributes.get("value", ""))
            except ValueError:
                raise child.fail("a film's size is no whole number; correct it") from None
        width, height = size.get("width", 768), size.get("height", 576)
        if min(width, height) < 1:
            raise film.fail(f"the film has {width} x {height} pixels; give it a size")
        what = f"line {film.line}: film of {width} x {height}"
        self._budget.check("picture_edge", max(width, height), what)
        self._budget.check("picture_texels", width * height, what)

    def _drop(self, element: Element) -> None:
        """Remove the shapes that cannot become triangles; Mitsuba never opens their files."""
        kept = []
        for child in element.children:
            if child.tag == "shape" and child.type in NO_TRIANGLES:
                if name := child.value("filename"):
                    self._files.find(name, child)
                called = child.attributes.get("id", f"{child.type} of line {child.line}")
                self._warn(f"shape '{called}': a {child.type} cannot become triangles and is left out")
            else:
                kept.append(child)
        element.children = kept

    def _file(self, element: Element, kind: str) -> None:
        named = [c for c in element.children if c.attributes.get("name") == "filename"]
        if len(named) != 1 or named[0].tag != "string":
            raise element.fail(f'the {element.type} has no file name; add <string name="filename" value="…"/>')
        named[0].attributes["value"] = self._files.checked(kind, named[0].attributes.get("value", ""), element)

    def _property(self, element: Element) -> None:
        if element.tag == "transform":
            for child in element.children:
                if child.tag not in NUMBERS or child.children:
                    raise child.fail(f"unexpected <{child.tag[:60]}> element inside <transform>; take it out")
                _check_numbers(child)
            return
        if element.children:
            inner = element.children[0]
            raise inner.fail(f"<{inner.tag[:60]}> stands inside <{element.tag}>, which holds a value; take it out")
        if element.tag in NUMBERS:
            if "filename" in element.attributes:
                element.attributes["value"] = self._files.spectrum(element.attributes.pop("filename"), element)
            _check_numbers(element)
        elif element.attributes.get("name") == "filename" and element.tag != "string":
            raise element.fail("a file name is a <string>; correct the element")

    def _name(self, element: Element) -> None:
        """Collect the targets of references."""
        key = element.attributes.get("as" if element.tag == "alias" else "id")
        if key is None or element.tag == "ref":
            return
        if key in self._named:
            raise element.fail(f"duplicate ID '{key[:60]}' (also on line {self._named[key].line}); rename one")
        if element.tag != "alias":
            self._named[key] = element
            return
        target = self._named.get(element.attributes.get("id", ""))
        if target is None:
            raise element.fail(f"alias of '{element.attributes.get('id', '')[:60]}', which is not above it; correct it")
        self._named[key] = target

    def _parts(self, element: Element) -> list[Element]:
        """List the nested objects, following references."""
        found = []
        for child in element.children:
            if child.tag == "ref":
                key = child.attributes.get("id", "")
                if key not in self._named:
                    raise child.fail(f'unresolved reference to "{key[:60]}"; name an object that exists')
                child = self._named[key]
            if child.tag in PLUGINS and (child.tag != "spectrum" or child.type):
                found.append(child)
        return found

    def _references(self) -> None:
        """Check every object: its parts exist, it has no cycle, and its expanded size is bounded."""
        done: dict[int, tuple[int, int, int]] = {}
        pending, path = [(self._root, False)], set[int]()
        while pending:
            element, leaving = pending.pop()
            key = id(element)
            parts = self._parts(element)
            if leaving:
                path.discard(key)
                done[key] = self._sums(element, parts, done)
            elif key not in done:
                if key in path:
                    raise element.fail("circular reference detected: the object is part of itself; take the <ref> out")
                path.add(key)
                pending.append((element, True))
                pending += [(part, False) for part in reversed(parts)]
        self._budget.check("instances", done[id(self._root)][2], "shapes, those of instances included")

    def _sums(
        self, element: Element, parts: list[Element], done: dict[int, tuple[int, int, int]]
    ) -> tuple[int, int, int]:
        """Count (levels, objects, shapes) that an element expands to."""
        needs = NEEDS.get((element.tag, element.type))
        if needs is not None:
            count = sum(part.tag == needs.kind for part in parts)
            if not needs.least <= count <= needs.most:
                wanted = needs.least if needs.least == needs.most else f"{needs.least} to {needs.most}"
                raise element.fail(
                    f'<{element.tag} type="{element.type}"> holds {count} <{needs.kind}>, expected {wanted}; correct it'
                )
        below = [done[id(part)] for part in parts]
        levels = 1 + max((b[0] for b in below), default=0)
        objects = 1 + sum(b[1] for b in below)
        group = any(part.tag == "shape" for part in parts)
        shapes = sum(b[2] for b in below) + (element.tag == "shape" and not group)
        if levels > MOST_DEPTH:
            raise element.fail(f"references are nested deeper than {MOST_DEPTH} levels; flatten the scene")
        if element.tag not in ("scene", "shape") and objects > MOST_PARTS:
            raise element.fail(f"<{element.tag}> unfolds to more than {MOST_PARTS} objects; simplify it")
        return levels, objects, shapes


def _all(root: Element) -> Iterator[Element]:
    pending = [root]
    while pending:
        element = pending.pop()
        yield element
        pending += reversed(element.children)


def _check_numbers(element: Element) -> None:
    """Check that numbers are finite in single precision; Mitsuba itself reports text that is no number."""
    for key, value in element.attributes.items():
        if key in ("name", "id", "type"):
            continue
        for part in re.split(r"[\s,:;]+", value):
            try:
                number = float(part)
            except ValueError:
                continue
            if not math.isfinite(number) or abs(number) > MOST:
                raise element.fail(f"<{element.tag}> holds {part[:40]}, which is no finite number; correct it")
