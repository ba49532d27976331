"""Samples as the networks of a field see them, and the errors of a prediction on them. N rows, all float32."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.surface.inputs import Inputs
from lightwell.networks.losses import EPSILON
from lightwell.transport.samples import Query, Samples


@dataclass(frozen=True)
class Examples:
    """Rows without the samples whose target is not finite or whose weight is 0."""

    query: Query
    features: np.ndarray
    """[N, F] inputs."""
    scale: np.ndarray
    """[N, 3] factor from a network's output to radiance in unit S: the reflectance, or 1."""
    half_a: np.ndarray
    """[N, 3] first half of the truth, radiance in unit S."""
    half_b: np.ndarray
    """[N, 3] second, independent half."""
    weight: np.ndarray
    """[N] importance weights."""
    row: np.ndarray
    """[N] int64, which sample each row was."""
    dropped: int
    """Samples that were not finite."""

    @staticmethod
    def of(samples: Samples, setup: FieldSetup, inputs: Inputs, demodulated: bool) -> Examples:
        """ValueError when nothing is left."""
        finite = np.isfinite(samples.half_a).all(axis=1) & np.isfinite(samples.half_b).all(axis=1)
        row = np.flatnonzero(finite & (np.asarray(samples.weight) > 0))
        if not len(row):
            raise ValueError(
                f"train: none of {len(samples)} samples has a finite target and a positive weight; "
                "look for broken materials with 'lightwell info' or trace again"
            )
        kept = samples[row]
        scale = kept.query.reflectance if demodulated else np.ones((len(row), 3))
        halves = (np.asarray(half / setup.unit, np.float32) for half in (kept.half_a, kept.half_b))
        weight = np.asarray(kept.weight, np.float32)
        features = inputs.rows(kept.query)
        dropped = int((~finite).sum())
        return Examples(kept.query, features, np.asarray(scale, np.float32), *halves, weight, row, dropped)

    def __len__(self) -> int:
        return len(self.row)

    def take(self, rows: np.ndarray) -> Examples:
        """Some of the rows."""
        columns = ("features", "scale", "half_a", "half_b", "weight", "row")
        return Examples(self.query[rows], **{n: getattr(self, n)[rows] for n in columns}, dropped=self.dropped)

    @property
    def radiance(self) -> np.ndarray:
        """[N, 3] mean of both halves."""
        return 0.5 * (self.half_a + self.half_b)

    @property
    def target(self) -> np.ndarray:
        """[N, 3] what a network's output should be."""
        return self.radiance / self.scale

    def relative_error(self, output: np.ndarray) -> np.ndarray:
        """[N] mean over channels of |f − y| / (y + ε), the noise of the truth included; output: [N, 3]."""
        y = self.radiance
        return (np.abs(output * self.scale - y) / (y + EPSILON)).mean(axis=1)

    def corrected_square(self, output: np.ndarray) -> np.ndarray:
        """[N] (f − A)(f − B) / (f² + ε²): squared relative residuals whose mean the noise of the truth does not raise.

        Single values may be negative. Its mean's root is the noise-corrected relative error.
        """
        f = output * self.scale
        return ((f - self.half_a) * (f - self.half_b) / (f * f + EPSILON**2)).mean(axis=1)
