"""Which pixels train: one per tile of a square grid whose side follows the number of records wanted."""

from __future__ import annotations

import math
from dataclasses import dataclass

# Limits and start of the side, pixels.
SMALLEST, LARGEST, FIRST = 1.0, 128.0, 8.0
# Records that a path is thought to leave before the first frame has told.
EXPECTED = 2.5
# Deviation from the target that is left alone.
SLACK = 0.04
# Slack from which sides are powers of the root of two: then all pictures of a size share a few recordings.
COARSE = 0.25


@dataclass
class Tiles:
    """The tile controller: side <- side * sqrt(last / target)."""

    target: int
    """Records per frame wanted."""
    fraction_max: float
    """Largest share of pixels that train."""
    side: float = FIRST
    """Pixels; kept as a fraction, rounded only when the grid is built."""
    slack: float = SLACK
    """Relative deviation from the target that changes nothing."""
    per_path: float = EXPECTED
    """Mean records of a path."""

    def wanted(self, width: int, height: int) -> float:
        """Records per frame that this picture can give at most, or the target."""
        return min(self.target, self.fraction_max * width * height * self.per_path)

    def grid(self, width: int, height: int) -> tuple[int, int, float, float]:
        """(columns, rows, tile width, tile height) that cover the picture; tiles may be a fraction of a pixel off."""
        columns = max(1, round(width / self.side))
        rows = max(1, round(height / self.side))
        return columns, rows, width / columns, height / rows

    def update(self, records: int, paths: int, width: int, height: int) -> None:
        """Adapt to what a frame gave; an empty frame changes nothing."""
        if records <= 0 or paths <= 0:
            return
        self.per_path += 0.25 * (records / paths - self.per_path)
        ratio = records / self.wanted(width, height)
        if abs(ratio - 1) <= self.slack:
            return  # Another number of paths is another recording (``training_frame``).
        self.side *= math.sqrt(ratio)
        if self.slack >= COARSE:
            self.side = 2 ** (round(2 * math.log2(self.side)) / 2)
        self.side = min(max(self.side, SMALLEST), LARGEST)
