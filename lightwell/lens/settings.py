"""Settings of the lens."""

from __future__ import annotations

from dataclasses import dataclass

from lightwell.lens.aperture import DISC, Aperture
from lightwell.lens.engine import TOLERANCE
from lightwell.lens.errors import LensError
from lightwell.lens.prescription import Prescription
from lightwell.lens.recipes import Recipe

PRESETS = ("default", "best", "paper")
EDGES = ("extend", "renormalise", "dark")


@dataclass(frozen=True)
class LensSettings:
    """Settings of the lens; the defaults are those of the command line."""

    aperture: Aperture = DISC
    """Shape of the opening."""
    layers: int = 2
    """Depth layers, 1 to 16. One layer ignores occlusion."""
    preset: str = "default"
    """``default`` (least squares, exact solve), ``best`` (more points), ``paper`` (the published recipe, pyramid)."""
    antialiased: bool = False
    """Whether pixels at depth edges hold light of both sides, which is then divided between the layers."""
    edges: str = "extend"
    """Light from outside the frame: ``extend`` repeats the border, ``renormalise`` divides by coverage, ``dark``."""
    solver: str = ""
    """``dst``, ``fft``, ``7/5``, ``5/3``; empty takes the preset's."""
    choice: str = "auto"
    """Node of a value between two: ``stochastic`` (dithered) or ``nearest``; ``auto``: nearest where steps are fine."""
    cats_eye: float = 0.0
    """Strength of mechanical vignetting at the corners, 0 or more, below 1.8; without motion, aperture round."""
    prescription: Prescription | None = None
    """A real lens in place of aperture and cat's eye; without motion."""
    largest: float = 256.0
    """Largest blur radius, pixels; larger blur is clamped. At most half the longer side of the frame is used."""
    tolerance: float = TOLERANCE
    """Error, relative to ``white``, above which a bright pixel uses lossless points; infinity: never."""
    white: float = 1.0
    """Scene-referred value that is displayed as white."""
    most_pixels: int = 1 << 22
    """Pixels of a layer that are blurred at a time; larger frames are blurred in bands, in bounded memory."""
    deterministic: bool = False
    """Add in integers: the same bytes on every run, thread count and machine."""

    def __post_init__(self) -> None:
        for name, known in (("preset", PRESETS), ("edges", EDGES), ("choice", ("auto", "stochastic", "nearest"))):
            if getattr(self, name) not in known:
                raise LensError(f"lens: {name} {getattr(self, name)!r}; choose {', '.join(known)}")
        if self.prescription is not None and (self.cats_eye or not self.aperture.round):
            raise LensError("lens: a prescription has an aperture and vignetting of its own; leave out the others")
        if not (isinstance(self.layers, int) and 1 <= self.layers <= 16):
            raise LensError(f"lens: {self.layers} layers; use 1 to 16")
        if not (isinstance(self.most_pixels, int) and self.most_pixels >= 1):
            raise LensError(f"lens: {self.most_pixels} pixels at a time; use 1 or more")
        if not self.largest > 0 or not self.white > 0 or not self.tolerance >= 0:
            raise LensError("lens: largest blur, white and tolerance must be above 0")

    def recipe(self) -> Recipe:
        """Return how the preset makes spreadlets.

        Returns:
            The recipe.
        """
        if self.preset == "best":
            return Recipe("best", base=40.0, slope=4.0, share=0.3)
        if self.preset == "paper":
            return Recipe("paper", share=0.093, anneal="working")
        return Recipe(self.preset)
