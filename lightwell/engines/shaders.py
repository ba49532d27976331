"""The learned fields of a bake as shader files of an engine."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.asset.export import ENDINGS, Exported, export_field
from lightwell.asset.records import FieldEntry
from lightwell.engines.bake import Bake
from lightwell.engines.exr_files import exr_bytes
from lightwell.engines.text import identifier
from lightwell.limits import Limits

# Longest name of a printed function.
MAX_FUNCTION = 32
# NumPy types of the formats of tables.
FORMATS: dict[str, np.dtype[Any]] = {"rgba16float": np.dtype("<f2"), "rgba32float": np.dtype("<f4")}


def function_name(entry: FieldEntry) -> str:
    """Name the function of a field.

    Args:
        entry: The field.

    Returns:
        ``lightwell_`` and the field's name.
    """
    return f"lightwell_{identifier(entry.name)}"[:MAX_FUNCTION].rstrip("_")


def shader_files(bake: Bake, to: str, limits: Limits | None = None) -> tuple[dict[str, bytes], dict[str, Exported]]:
    """Print every field of a bake; one that cannot be printed is a ``ValueError``.

    Args:
        bake: The bake.
        to: A language of ``lightwell.asset.export.TARGETS``.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        Files by name: texts, tables as EXR pictures, pictures as PNG; and what was printed, by the function's name.
    """
    files, printed = {}, {}
    for entry in bake.fields:
        name = function_name(entry)
        made = export_field(bake.path, to, field=entry.name, name=name, limits=limits)
        printed[name] = made
        files[f"{name}{ENDINGS[to]}"] = made.text.encode()
        files |= {f"{picture}.png": data for picture, data in made.pictures.items()}
        files |= {f"{table}.exr": table_picture(made, table) for table in made.tables}
    return files, printed


def table_picture(made: Exported, table: str) -> bytes:
    """Write a table of a shader as a picture of floats.

    Args:
        made: The printed shader.
        table: Name of one of its tables.

    Returns:
        Bytes of an EXR file with the channels R, G, B and A.
    """
    width, height, form = made.sizes[table]
    values = np.frombuffer(made.tables[table], FORMATS[form]).reshape(height, width, 4)
    return exr_bytes(values.astype(np.float32))
