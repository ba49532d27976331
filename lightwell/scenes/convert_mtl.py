"""Material libraries (MTL) and relative indices of OBJ files, in the forms that trimesh reads."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from lightwell.scenes.convert_files import Folder
from lightwell.scenes.glb_writer import CLAMP, REPEAT

# The name under which trimesh asks for the joined libraries of a file.
LIBRARY = "<libraries>"
# Options of a map with numbers, and how many: the others of up to three have defaults.
NUMBERS = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2, "-bm": 1, "-boost": 1, "-texres": 1}
# Options of a map with one word.
WORDS = {"-blendu", "-blendv", "-cc", "-clamp", "-imfchan", "-type"}
# Values that change nothing, of the options that change colours and are not read.
NEUTRAL = {"-mm": ("0", "1"), "-t": ("0", "0", "0")}
# Statements of three numbers, of which the last two may be left out, and of one.
COLORS, SCALARS = {"ka", "kd", "ks", "ke"}, {"ns", "ni", "pr", "pm", "d", "tr"}


@dataclass(frozen=True)
class MapStatement:
    """A statement such as ``map_Kd -s 2 2 1 -clamp on wood floor.png`` without its first word."""

    file: str
    scale: tuple[float, float] = (1.0, 1.0)
    """Factor of the texture coordinates: 2 shows the picture twice, as three.js, Blender and Assimp read it."""
    offset: tuple[float, float] = (0.0, 0.0)
    """Added to the scaled coordinates; v counts upwards."""
    wrap: tuple[int, int] = (REPEAT, REPEAT)
    ignored: tuple[str, ...] = ()
    """Options that change colours and are not read."""

    @property
    def transform(self) -> dict[str, list[float]] | None:
        """KHR_texture_transform, whose v counts downwards; None where the coordinates stay as they are."""
        (su, sv), (u, v) = self.scale, self.offset
        return None if (su, sv, u, v) == (1, 1, 0, 0) else {"offset": [u, 1 - sv - v], "scale": [su, sv]}


def map_statement(text: str) -> MapStatement:
    """Read the options and the file name of a map.

    Args:
        text: What follows the first word of the statement.

    Returns:
        The statement; a name may hold blanks.
    """
    rest, said = text.strip(), dict[str, list[str]]()
    while option := re.match(r"(-[A-Za-z]+)\s+", rest):
        name = option[1].lower()
        if name not in NUMBERS and name not in WORDS:
            break
        rest, values = rest[option.end() :], list[str]()
        # The last word is always the file's.
        while len(values) < NUMBERS.get(name, 1) and (word := re.match(r"(\S+)\s+", rest)):
            if name in NUMBERS and _number(word[1]) is None:
                break
            values.append(word[1])
            rest = rest[word.end() :]
        said[name] = values
    su, sv = _pair(said.get("-s", []), 1.0)
    u, v = _pair(said.get("-o", []), 0.0)
    wrap = CLAMP if [word.lower() for word in said.get("-clamp", [])] == ["on"] else REPEAT
    ignored = [n for n in said if n == "-imfchan" or (n in NEUTRAL and not _is_neutral(said[n], NEUTRAL[n]))]
    return MapStatement(rest, (su, sv), (u, v), (wrap, wrap), tuple(ignored))


def _is_neutral(values: list[str], neutral: tuple[str, ...]) -> bool:
    return all(float(value) == float(none) for value, none in zip(values, neutral))


def _pair(values: list[str], default: float) -> tuple[float, float]:
    found = [*map(float, values), default, default]
    return (found[0], found[1]) if values else (default, default)


def _number(word: str) -> float | None:
    """A finite number, or None."""
    try:
        value = float(word)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


class MaterialFiles(Folder):
    """The files of a folder, asked for by the statements of an OBJ file and its material libraries."""

    def __init__(self, path: Path, most_bytes: int) -> None:
        """Take a folder.

        Args:
            path: The folder.
            most_bytes: Bytes that may be read from it in all.
        """
        super().__init__(path, most_bytes)
        self._libraries: list[str] = []

    def __getitem__(self, name: str) -> bytes:
        if name == LIBRARY:
            return "\n".join(self._libraries).encode()
        return super().__getitem__(map_statement(name).file)

    def add_library(self, statement: str) -> None:
        """Add the material libraries that a statement names.

        Args:
            statement: What follows ``mtllib``: one name, which may hold blanks, or several.
        """
        names = [statement] if statement in self else statement.split()
        found = [name for name in names if name in self]
        if found:
            self.missing.discard(statement)
        elif len(names) > 1:
            self.missing -= set(names)
        for name in found:
            self._libraries += [_plain(line) for line in decoded(self[name]).splitlines()]


def decoded(data: bytes) -> str:
    """Decode the text of a file as trimesh does.

    Args:
        data: UTF-8 or another encoding, which is guessed.

    Returns:
        The text.
    """
    from trimesh.util import decode_text

    try:
        return str(decode_text(data))
    except (ImportError, LookupError):
        return data.decode("latin-1")


def prepared(text: str, files: MaterialFiles) -> str:
    """Prepare an OBJ file for trimesh, which reads the first material library alone and counts relative indices from
    the end of the file.

    Args:
        text: The file.
        files: Takes its material libraries.

    Returns:
        The same file with one library and absolute indices.

    Raises:
        ValueError: A relative index goes beyond the first vertex.
    """
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\\\n", "")
    statements = [s.strip() for s in re.findall(r"^[ \t]*mtllib[ \t]+(.+)$", text, re.MULTILINE)]
    for statement in dict.fromkeys(statements):
        files.add_library(statement)
    if re.search(r"^f[ \t].*[ \t/]-\d", text, re.MULTILINE):
        text = _absolute(text)
    return f"mtllib {LIBRARY}\n{text.lstrip()}" if statements else text


def _absolute(text: str) -> str:
    """Count the relative indices of faces from the elements before the face."""
    counts = {"v": 0, "vt": 0, "vn": 0}
    lines = text.split("\n")
    for i, line in enumerate(lines):
        words = line.split()
        if words and words[0] in counts:
            counts[words[0]] += 1
        elif words and words[0] == "f" and "-" in line:
            corners = line.split("#")[0].split()[1:]
            lines[i] = " ".join(["f", *(_corner(corner, list(counts.values())) for corner in corners)])
    return "\n".join(lines)


def _corner(corner: str, counts: list[int]) -> str:
    parts = corner.split("/")
    for k, (part, count) in enumerate(zip(parts, counts)):
        if part.startswith("-"):
            index = int(part) + count + 1
            if index < 1:
                raise ValueError(f"a face names element {part[:20]} of {count} before it")
            parts[k] = str(index)
    return "/".join(parts)


def _plain(line: str) -> str:
    """A statement with the number of values that trimesh expects: it gives up all materials for one of another."""
    words = line.split()
    key = words[0].lower() if words else ""
    if key not in COLORS | SCALARS:
        return line
    values = []
    for word in words[1:]:
        if word.startswith("#"):
            break
        values.append(word)
    if not values or any(_number(value) is None for value in values):
        # A spectrum, which is not read.
        return f"{key}:{values[0]} {values[-1]}" if values else ""
    if key in SCALARS:
        return f"{words[0]} {values[0]}"
    # Green and blue that are left out are those of red.
    return " ".join([words[0], *(values[:3] if len(values) >= 3 else values[:1] * 3)])
