"""Columns of shards that are no part of samples."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lightwell.core import formats
from lightwell.core.store import Store
from lightwell.transport.shards import shard_key


def stored_columns(folder: str | Path, shards: int, names: Sequence[str]) -> list[np.ndarray]:
    """Read columns of a folder of shards that are no part of samples, such as ``triangle``.

    Args:
        folder: Folder that ``generate`` has written.
        shards: Number of shards to read, from the first.
        names: Names of columns.

    Returns:
        The columns [N, ...], in the order of ``names``.

    Raises:
        ValueError: A shard is missing.
    """
    folder = Path(folder)
    found, store = json.loads((folder / "manifest.json").read_text()), Store(folder, limit=None)
    parts = [store.find(shard_key(found, index), formats.COLUMNS) for index in range(shards)]
    if any(part is None for part in parts):
        raise ValueError(f"samples: '{folder}' has lost a shard; run generate() again")
    return [np.concatenate([part[name] for part in parts if part is not None]) for name in names]
