"""Small JSON files of a work folder, such as plans and manifests."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

LOG = logging.getLogger("lightwell.store")


def read_json(path: Path, kind: type) -> Any:
    """Read a JSON file that a killed or older process may have left.

    Args:
        path: The file.
        kind: Type of its value: ``dict`` or ``list``.

    Returns:
        The value, or None where the file is absent, or damaged or of another type, which the log notes in one line.
    """
    try:
        found = json.loads(path.read_text())
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:100]
    else:
        if isinstance(found, kind):
            return found
        reason = f"it holds a {type(found).__name__}, not a {kind.__name__}"
    LOG.warning("'%s' is damaged and is made again (%s)", path, reason)
    return None
