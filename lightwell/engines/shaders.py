"""The learned fields of a bake as shader files of an engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lightwell.asset.export import ENDINGS, Exported, export_field
from lightwell.asset.records import FieldEntry
from lightwell.engines.bake import Bake
from lightwell.engines.exr_files import exr_bytes
from lightwell.engines.text import identifier
from lightwell.graph.pictures import decoded, encode
from lightwell.limits import Limits

# Longest name of a printed function.
MAX_FUNCTION = 32
# NumPy types of the formats of tables.
FORMATS: dict[str, np.dtype[Any]] = {"rgba16float": np.dtype("<f2"), "rgba32float": np.dtype("<f4")}


def function_names(fields: Sequence[FieldEntry]) -> dict[str, str]:
    """Name the functions of fields, which are also the beginnings of file names.

    Args:
        fields: The fields of a bake.

    Returns:
        ``lightwell_`` and the field's name, by the field's name; names that are equal as far as they go get a number.
    """
    found: dict[str, str] = {}
    # Some file systems know no difference between capital and small letters.
    taken: set[str] = set()
    for entry in fields:
        whole = f"lightwell_{identifier(entry.name)}"
        name, number = whole[:MAX_FUNCTION].rstrip("_"), 2
        while name.lower() in taken:
            end = f"_{number}"
            name, number = whole[: MAX_FUNCTION - len(end)].rstrip("_") + end, number + 1
        taken.add(name.lower())
        found[entry.name] = name
    return found


def shader_files(
    bake: Bake, to: str, limits: Limits | None = None, bottom_up: bool = False
) -> tuple[dict[str, bytes], dict[str, Exported]]:
    """Print every field of a bake; one that cannot be printed is a ``ValueError``.

    Args:
        bake: The bake.
        to: A language of ``lightwell.asset.export.TARGETS``.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.
        bottom_up: Whether the engine's textures begin with the lowest row of a picture: rows are written in reverse.

    Returns:
        Files by name: texts, tables as EXR pictures, pictures as PNG; and what was printed, by the function's name.
    """
    files, printed, names = {}, {}, function_names(bake.fields)
    for entry in bake.fields:
        name = names[entry.name]
        made = export_field(bake.path, to, field=entry.name, name=name, limits=limits)
        printed[name] = made
        files[f"{name}{ENDINGS[to]}"] = made.text.encode()
        pictures = made.pictures.items()
        files |= {f"{name}.png": encode(decoded(png)[::-1], "png").data if bottom_up else png for name, png in pictures}
        files |= {f"{table}.exr": table_picture(made, table, bottom_up) for table in made.tables}
    return files, printed


def table_picture(made: Exported, table: str, bottom_up: bool = False) -> bytes:
    """Write a table of a shader as a picture of floats.

    Args:
        made: The printed shader.
        table: Name of one of its tables.
        bottom_up: Whether the table's first row is the lowest of the picture.

    Returns:
        Bytes of an EXR file with the channels R, G, B and A.
    """
    width, height, form = made.sizes[table]
    values = np.frombuffer(made.tables[table], FORMATS[form]).reshape(height, width, 4)
    return exr_bytes((values[::-1] if bottom_up else values).astype(np.float32))
