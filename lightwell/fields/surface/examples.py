"""Samples as inputs and targets of networks, and the errors of a prediction on them. N rows; all arrays are float32."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.surface.inputs import Inputs
from lightwell.networks.losses import EPSILON
from lightwell.transport.samples import Query, Samples


@dataclass(frozen=True)
class Examples:
    """Training samples; those whose target is not finite or whose weight is 0 are left out."""

    query: Query
    features: np.ndarray
    """[N, F] inputs."""
    scale: np.ndarray
    """[N, 3] factor from a network's output to radiance in unit S: the reflectance, or 1."""
    half_a: np.ndarray
    """[N, 3] first half of the reference, radiance in unit S."""
    half_b: np.ndarray
    """[N, 3] second, independent half."""
    weight: np.ndarray
    """[N] importance weights."""
    row: np.ndarray
    """[N] int64 index of the sample of each row."""
    dropped: int
    """Samples that were not finite."""

    @staticmethod
    def of(samples: Samples, setup: FieldSetup, inputs: Inputs, demodulated: bool) -> Examples:
        """Compute inputs and targets of samples.

        Args:
            samples: Path-traced samples.
            setup: Bounds and radiance unit of the scene.
            inputs: Inputs of the networks.
            demodulated: Whether targets are divided by the reflectance.

        Returns:
            The usable samples.

        Raises:
            ValueError: No sample has a finite target and a positive weight.
        """
        finite = np.isfinite(samples.half_a).all(axis=1) & np.isfinite(samples.half_b).all(axis=1)
        row = np.flatnonzero(finite & (np.asarray(samples.weight) > 0))
        if not len(row):
            raise ValueError(
                f"train: none of {len(samples)} samples has a finite target and a positive weight; "
                "look for broken materials with 'lightwell info' or trace again"
            )
        kept = samples[row]
        scale = kept.query.reflectance if demodulated else np.ones((len(row), 3))
        a, b = (np.asarray(half / setup.unit, np.float32) for half in (kept.half_a, kept.half_b))
        weight = np.asarray(kept.weight, np.float32)
        features = inputs.rows(kept.query)
        dropped = int((~finite).sum())
        return Examples(kept.query, features, np.asarray(scale, np.float32), a, b, weight, row, dropped)

    def __len__(self) -> int:
        return len(self.row)

    def take(self, rows: np.ndarray) -> Examples:
        """Select rows.

        Args:
            rows: [K] int indices, or [N] bool.

        Returns:
            The selected rows.
        """
        columns = ("features", "scale", "half_a", "half_b", "weight", "row")
        return Examples(self.query[rows], **{n: getattr(self, n)[rows] for n in columns}, dropped=self.dropped)

    @property
    def radiance(self) -> np.ndarray:
        """[N, 3] mean of both halves."""
        return 0.5 * (self.half_a + self.half_b)

    @property
    def target(self) -> np.ndarray:
        """[N, 3] target of a network's output."""
        return self.radiance / self.scale

    def relative_error(self, output: np.ndarray) -> np.ndarray:
        """Compute the relative error of each row; the noise of the reference is part of it.

        Args:
            output: [N, 3] outputs of the network.

        Returns:
            [N] mean over channels of |f − y| / (y + ε), in unit S.
        """
        y = self.radiance
        return (np.abs(output * self.scale - y) / (y + EPSILON)).mean(axis=1)

    def corrected_square(self, output: np.ndarray) -> np.ndarray:
        """Compute squared relative residuals whose mean is free of the noise of the reference.

        The two halves A and B of the reference are independent: (f − A)(f − B) / (f² + ε²). The root of the mean is the
        noise-corrected relative error. Single values may be negative.

        Args:
            output: [N, 3] outputs of the network.

        Returns:
            [N] mean over channels.
        """
        f = output * self.scale
        return ((f - self.half_a) * (f - self.half_b) / (f * f + EPSILON**2)).mean(axis=1)
