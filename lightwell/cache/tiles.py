"""Choice of training pixels: one per tile of a square grid, whose side follows the wanted number of records."""

from __future__ import annotations

import math
from dataclasses import dataclass

# Limits and start of the side, pixels.
SMALLEST, LARGEST, FIRST = 1.0, 128.0, 8.0
# Assumed records per path before the first frame has been measured.
EXPECTED = 2.5
# Relative deviation from the target that causes no change, and sides per factor of two: a camera that moves
# meets few sides. Each is another recording, and on a GPU seconds of compilation.
SLACK, FINE_STEPS = 0.12, 8
# Slack from which sides are powers of the square root of two, so that all images of a size share a few recordings.
COARSE, COARSE_STEPS = 0.25, 2


@dataclass
class Tiles:
    """Controller of the tile size: side ← side * sqrt(last / target)."""

    target: int
    """Wanted records per frame."""
    fraction_max: float
    """Largest share of the pixels from which training paths start."""
    side: float = FIRST
    """Side of a tile, pixels; a fraction that is rounded only when the grid is built."""
    slack: float = SLACK
    """Relative deviation from the target that changes nothing."""
    per_path: float = EXPECTED
    """Mean records of a path."""

    def wanted(self, width: int, height: int) -> float:
        """Return the number of records to aim at.

        Args:
            width: Image width, pixels.
            height: Image height, pixels.

        Returns:
            The target, or the largest number that the image can give.
        """
        return min(self.target, self.fraction_max * width * height * self.per_path)

    def grid(self, width: int, height: int) -> tuple[int, int, float, float]:
        """Divide an image into tiles, whose sizes are adjusted by a fraction of a pixel to cover it.

        Args:
            width: Image width, pixels.
            height: Image height, pixels.

        Returns:
            Columns, rows, tile width and tile height; sizes in pixels.
        """
        columns = max(1, round(width / self.side))
        rows = max(1, round(height / self.side))
        return columns, rows, width / columns, height / rows

    def update(self, records: int, paths: int, width: int, height: int) -> None:
        """Adapt the side to the records of a frame; an empty frame changes nothing.

        Args:
            records: Records of the frame.
            paths: Training paths of the frame.
            width: Image width, pixels.
            height: Image height, pixels.
        """
        if records <= 0 or paths <= 0:
            return
        self.per_path += 0.25 * (records / paths - self.per_path)
        ratio = records / self.wanted(width, height)
        if abs(ratio - 1) <= self.slack:
            return  # A different number of paths would need another recording (``training_frame``).
        self.side *= math.sqrt(ratio)
        steps = COARSE_STEPS if self.slack >= COARSE else FINE_STEPS
        self.side = 2 ** (round(steps * math.log2(self.side)) / steps)
        self.side = min(max(self.side, SMALLEST), LARGEST)
