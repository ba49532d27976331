"""Animations of a file that change its lights: keys of intensities and colours, as factors of those at rest."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lightwell.scenes.errors import SceneError

LightPath = Literal["intensity", "color"]
Interpolation = Literal["LINEAR", "STEP", "CUBICSPLINE"]
# Keys of two lights that differ less, relative to the largest, are the same.
SAME = 1e-4


@dataclass(frozen=True)
class Keys:
    """Keys of one animated value, as glTF 2.0 has them (appendix C)."""

    times: np.ndarray
    """[K] float32 increasing, seconds."""
    values: np.ndarray
    """[K, C] factors; of a cubic spline [K, 3, C]: arriving tangent, factor, leaving tangent."""
    interpolation: Interpolation

    def same(self, other: Keys) -> bool:
        """Test whether another light changes alike.

        Args:
            other: Its keys.

        Returns:
            Whether times, factors and interpolation are the same.
        """
        alike = self.interpolation == other.interpolation and self.values.shape == other.values.shape
        if not alike or not np.allclose(self.times, other.times, rtol=0, atol=SAME):
            return False
        return bool(np.abs(self.values - other.values).max() <= SAME * max(1.0, np.abs(self.values).max()))

    def grey(self) -> Keys | None:
        """Reduce three factors to one.

        Returns:
            The keys of one factor; None where the three differ.
        """
        spread = np.ptp(self.values, axis=-1).max()
        return None if spread > SAME else Keys(self.times, self.values[..., :1], self.interpolation)


@dataclass(frozen=True)
class LightTrack:
    """One animated value of one light or material of a file."""

    path: LightPath
    """'color' of a material is its emissive factor, 'intensity' its emissive strength."""
    keys: Keys
    lights: tuple[int, ...] = ()
    """Where it is a light: indices into ``Scene.lights``, one for each node that has it."""
    material: int | None = None
    """Where it is a material: index into ``Scene.materials``."""


@dataclass(frozen=True)
class LightClip:
    """One animation, as far as it changes lights."""

    name: str
    tracks: tuple[LightTrack, ...] = ()
    dark: tuple[str, ...] = ()
    """Names of lights that it turns on, and which are off at rest: nothing is baked that could be multiplied."""


@dataclass(frozen=True)
class LightClips:
    """The animations of a file that change its lights. A defect is kept until they are used."""

    names: tuple[str, ...] = ()
    found: tuple[LightClip, ...] = field(default=(), repr=False)
    defect: str = ""

    def read(self) -> tuple[LightClip, ...]:
        """Return the animations.

        Returns:
            One record an animation.

        Raises:
            SceneError: They are damaged; one line with the cure.
        """
        if self.defect:
            raise SceneError(self.defect)
        return self.found


NO_CLIPS = LightClips()
