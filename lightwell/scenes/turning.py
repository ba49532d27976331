"""An environment map that turns about the vertical axis.

The light of a turned map is a declared light of its own: the map is taken out of the scene's own emitters, and the
fields read where its north has turned to, a unit vector: cosine and sine of the angle, which is periodic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.core.environment_text import ENVIRONMENT, ROTATED

# An angle counts as inside of a range that it misses by less, degrees: directions are stored in single precision.
NEAR = 1e-3


@dataclass(frozen=True)
class Turning:
    """The environment map of the scene, turned. The field is learned for its radiance as the file has it."""

    first: float
    """Smallest angle, degrees; clockwise seen from above."""
    last: float
    """Largest angle, degrees."""
    name: str = ENVIRONMENT
    kind: str = "environment"

    @property
    def initial(self) -> float:
        """Angle that is shown first, degrees: the map as the file has it, where the range holds that."""
        return float(np.clip(0.0, self.first, self.last))

    def direction(self, angle: float | np.ndarray) -> np.ndarray:
        """Compute where the map's north (-Z) has turned to.

        Args:
            angle: [...] degrees.

        Returns:
            [..., 3] horizontal unit directions.
        """
        turn = np.radians(np.asarray(angle, np.float64))
        return np.stack([np.sin(turn), np.zeros_like(turn), -np.cos(turn)], axis=-1)

    def angle(self, direction: np.ndarray) -> np.ndarray:
        """Compute the angle of directions of the map's north.

        Args:
            direction: [..., 3] directions.

        Returns:
            [...] degrees in the range; the nearest end beside it.
        """
        way = np.asarray(direction, np.float64)
        found = self.first + (np.degrees(np.arctan2(way[..., 0], -way[..., 2])) - self.first) % 360
        # The last numbers before a whole turn are those just below the first angle.
        found = np.where(found - self.first > 360 - NEAR, self.first, found)
        beyond = found - self.last
        return np.where(beyond > 0, np.where(beyond > (360 + self.first - self.last) / 2, self.first, self.last), found)

    def at(self, angle: float) -> np.ndarray:
        """Compute the direction of an angle that someone asks for.

        Args:
            angle: Degrees; whole turns do not matter.

        Returns:
            [3] unit direction.

        Raises:
            ValueError: The map is not turned so far.
        """
        if not any(self.first - NEAR <= angle + turn <= self.last + NEAR for turn in (-360, 0, 360)):
            raise ValueError(
                f"{ROTATED}={angle:g} is outside of {self.first:g}..{self.last:g}; choose an angle between them"
            )
        return self.direction(angle)

    def sample(self, u: np.ndarray) -> np.ndarray:
        """Map random numbers to directions.

        Args:
            u: [N] or [N, 1] numbers in [0, 1).

        Returns:
            [N, 3] float32 unit directions.
        """
        share = np.asarray(u).reshape(-1)
        return self.direction(self.first + share * (self.last - self.first)).astype(np.float32)
