"""The exposure that a baked file asks for, so that every viewer shows it as its page does."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from lightwell.asset.container import pack, read_file, unpack
from lightwell.asset.records import EXTENSION
from lightwell.files import write_atomically


def declared_exposure(path: str | Path) -> float | None:
    """Read the exposure of a baked file.

    Args:
        path: A GLB; another file, or an exposure that is not a positive number, is a ``ValueError``.

    Returns:
        Factor on radiance before tone mapping; None where the file is absent, or declares none.
    """
    if not Path(path).is_file():
        return None
    document, _ = read_file(path)
    exposure = document.get("extensions", {}).get(EXTENSION, {}).get("exposure")
    return None if exposure is None else _positive(exposure)


def declare_exposure(path: str | Path, exposure: float) -> int:
    """Write the exposure into the learned light of a baked file, in place of one that is there.

    Args:
        path: A GLB with learned light; it is replaced as a whole.
        exposure: Factor on radiance before tone mapping, > 0.

    Returns:
        Number of bytes of the new file.

    Raises:
        ValueError: The exposure is not a positive number, or the file is no GLB with learned light.
    """
    exposure = _positive(exposure)
    document, binary = unpack(Path(path).read_bytes())
    extension = document.get("extensions", {}).get(EXTENSION)
    if extension is None:
        raise ValueError(f"{path}: expected learned light, found none; bake it")
    extension["exposure"] = exposure
    return write_atomically(path, pack(document, binary))


def _positive(exposure: Any) -> float:
    if not isinstance(exposure, (int, float)) or not (math.isfinite(exposure) and exposure > 0):
        raise ValueError(f"asset: exposure is {exposure}, expected a positive number")
    return float(exposure)
