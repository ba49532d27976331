"""Options of light probes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lightwell.core.options import option
from lightwell.core.units import metres

Box = tuple[float, float, float, float, float, float]


def parse_box(text: str) -> Box:
    """Read a box from text.

    Args:
        text: 'x0,y0,z0,x1,y1,z1' in metres, the smallest corner first.

    Returns:
        The six numbers.

    Raises:
        ValueError: The text is not a box.
    """
    try:
        box = tuple(float(part) for part in text.split(","))
    except ValueError:
        box = ()
    if len(box) != 6 or not all(abs(v) < float("inf") for v in box) or any(a > b for a, b in zip(box[:3], box[3:])):
        raise ValueError(f"'{text}' is no box; give x0,y0,z0,x1,y1,z1 in metres, smallest corner first")
    return box


@dataclass(frozen=True)
class ProbesOptions:
    """Options of ``--field probes``."""

    spacing: float | None = option(
        None,
        "distance of neighbouring probes, 1m or 50cm (default: an eighth of the longest edge, less in flat scenes)",
        parse=metres,
        metavar="LENGTH",
        check=lambda v: "" if 0 < v < float("inf") else "is not a length; give metres, such as 1m",
    )
    rebake: Path | None = option(
        None,
        "an edit of the bake in OLD (made with --keep): only what --box touches is baked again, nothing is scored",
        parse=Path,
        metavar="OLD",
    )
    box: Box | None = option(
        None, "where the scene has changed since --rebake OLD, metres", parse=parse_box, metavar="x0,y0,z0,x1,y1,z1"
    )

    def __post_init__(self) -> None:
        """Refuse ``--rebake`` without ``--box`` and the reverse."""
        if (self.rebake is None) != (self.box is None):
            raise ValueError("bake: --rebake OLD and --box x0,y0,z0,x1,y1,z1 belong together; give both")
