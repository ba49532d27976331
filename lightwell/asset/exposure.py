"""The exposure that a baked file asks for, so that every viewer shows it as its page does."""

from __future__ import annotations

import math
from pathlib import Path

from lightwell.asset.container import pack, unpack
from lightwell.asset.records import EXTENSION
from lightwell.files import write_atomically


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
    if not (math.isfinite(exposure) and exposure > 0):
        raise ValueError(f"asset: exposure is {exposure}, expected a positive number")
    document, binary = unpack(Path(path).read_bytes())
    extension = document.get("extensions", {}).get(EXTENSION)
    if extension is None:
        raise ValueError(f"{path}: expected learned light, found none; bake it")
    extension["exposure"] = float(exposure)
    return write_atomically(path, pack(document, binary))
