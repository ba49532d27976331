"""The network of a cache with its weights, and the factors from its output to radiance."""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.brightness_correction import CorrectedScaling, RadianceScaling
from lightwell.cache.features import Vertex
from lightwell.cache.learner import Learner
from lightwell.cache.model import Model
from lightwell.cache.scale import RadianceScale
from lightwell.cache.settings import CacheSettings

PackedWeights = tuple[tuple[Any, ...], RadianceScaling]
"""Weights in the layout of kernels, and the factor from network output to radiance."""


class Predictor:
    """Predicts scattered radiance."""

    def __init__(self, settings: CacheSettings) -> None:
        """Make an untrained network.

        Args:
            settings: Settings of the cache.
        """
        self.model = Model(settings.network)
        self.learner = Learner(self.model, settings.training, settings.seed)
        self.scale = RadianceScale(settings.training.radiance_scale)
        self.level: mi.Float | None = None
        """Local gain of a still, see ``CellSums.levels``; None: 1 everywhere."""
        self._packs: dict[str, PackedWeights] = {}

    def correct(self, level: mi.Float | None) -> None:
        """Set the local gain.

        Args:
            level: [``CELLS``] factors; None: 1 everywhere.
        """
        self.level = level
        self.touched()

    def touched(self) -> None:
        """Discard packed copies after a change of weights, scale or gain."""
        self._packs.clear()

    def packed(self, which: str = "ema") -> PackedWeights:
        """Return the weights in the layout of kernels, with the factor to radiance.

        Args:
            which: 'ema': averaged weights, for pixels; 'raw': the newest ones.

        Returns:
            Packed weights and ``RadianceScaling``.
        """
        key = "raw" if which == "raw" or self.learner.shown is self.learner.values else "ema"
        if key not in self._packs:
            views = self.model.packed(self.learner.values if key == "raw" else self.learner.shown)
            dr.eval(views)
            unscale = dr.opaque(mi.Float, 1 / self.scale.value)
            scaling = RadianceScaling(unscale) if self.level is None else CorrectedScaling(unscale, self.level)
            self._packs[key] = (views, scaling)
        return self._packs[key]

    def radiance(self, packed: PackedWeights, v: Vertex) -> mi.Color3f:
        """Predict the scattered radiance towards ``v.w``.

        Args:
            packed: Result of ``packed``.
            v: Vertices.

        Returns:
            [N] radiance, ≥ 0.
        """
        return self.model.radiance(packed[0], v, packed[1])
