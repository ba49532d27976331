"""Gradient steps of the cache: loss, Adam, and the averaged weights, in one frozen function.

Müller et al. 2021 (loss, averaging in its corrected form), Kingma & Ba 2015 (Adam), Lehtinen et al. 2018 (normalising
by the prediction keeps the minimum of the loss at the mean of noisy targets).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, freeze, mi
from lightwell.cache.model import Model, Tensors
from lightwell.cache.settings import TrainingSettings
from lightwell.networks.device import tensors

# Relative loss: the term that keeps the division finite, and the weights of luminance (Müller et al. 2021).
LOSS_EPSILON = 0.01
LUMINANCE = (0.299, 0.587, 0.114)
# Adam. A small decay of the second moment clips the gradients of rare bright records and darkens the fit. (A decay that
# grows with the steps discards the large first gradients, but fits no better.)
BETA_1, BETA_2, EPSILON, TABLE_EPSILON = 0.9, 0.999, 1e-8, 1e-15
# Weight decay of the layers.
DECAY = 1e-6


@dataclass(frozen=True)
class Batch:
    """Records of one or more gradient steps in random order; rows beyond the last record have weight 0."""

    direct: Any
    """[N, K] inputs beside the hash grid."""
    points: Any
    """[N, 3] positions relative to the scene's box, [0, 1]^3."""
    target: Any
    """[N, 3] targets in units of the network."""
    weight: Any
    """[N, 3] 1 where the channel has a target, else 0."""


def averaging(decay: float, step: int, early: float = 0.0) -> tuple[float, float]:
    """Compute the weights of the running average of the network's weights; they add up to 1.

    With η_t = 1 - decay^t the average is (1 - decay) / η_t W_t + decay η_(t-1) / η_t W_(t-1) (the factor η_(t-1) is
    missing in some printed versions, whose factors add up to less than 1).

    For the first 1 / (1 - decay) steps this is close to the plain mean of all steps, those of an untrained network
    included. ``early`` = g > 0 gives the newest weights at least (g + 1) / (t + g), so that the average covers only
    about the last t / g steps (polynomial-decay averaging, Shamir and Zhang 2013).

    Args:
        decay: Decay per step, in [0, 1).
        step: Gradient step t = 1, 2, …
        early: g ≥ 0; 0: no polynomial decay.

    Returns:
        Factor of the new weights and factor of the old average.
    """
    new = (1 - decay) / (1 - decay**step)
    if early > 0:
        new = max(new, (early + 1) / (step + early))
    return new, 1 - new


def luminance(output: Any) -> Any:
    """Compute the luminance of network outputs (detached, negative values clamped to 0) or of targets.

    Args:
        output: [B, 3] tensor.

    Returns:
        [B, 3] tensor, whose columns are equal: no kernel of its own, as a product of matrices would be.
    """
    flat = dr.detach(output).array
    row = dr.arange(mi.UInt32, dr.width(flat)) // 3 * 3
    channels = [dr.maximum(dr.gather(mi.Float, flat, row + k), 0) for k in range(3)]
    return mi.TensorXf(sum(weight * c for weight, c in zip(LUMINANCE, channels)), output.shape)


def believed(output: Any, target: Any, cap: float) -> Any:
    """Clamp targets to a multiple of the prediction, keeping the hue.

    The limit is ``cap`` times the predicted luminance plus one (the mean target is one). It is relative to the
    prediction, because places close to a light are much brighter than the mean.

    Args:
        output: [B, 3] prediction.
        target: [B, 3] targets.
        cap: Largest ratio; ≤ 0: no limit.

    Returns:
        [B, 3] clamped targets.
    """
    if cap <= 0:
        return target
    return target * dr.minimum(1, cap * (luminance(output) + 1) / dr.maximum(luminance(target), 1e-6))


def loss(output: Any, target: Any, weight: Any) -> Any:
    """Compute the relative squared loss (f - y)² / (sg(lum f)² + 0.01) of each output.

    Args:
        output: [B, 3] prediction f.
        target: [B, 3] targets y.
        weight: [B, 3] 0 or 1.

    Returns:
        [B, 3]; differentiable in ``output``, whose luminance in the denominator is a constant (sg: stop gradient). The
        optimiser minimises its sum over the sum of the weights.
    """
    return dr.square(output - target) * (weight / (dr.square(luminance(output)) + LOSS_EPSILON))


def sums(*values: Any) -> list[mi.Float]:
    """Sum tensors of one shape in one reduction.

    Args:
        *values: [B, 3] tensors.

    Returns:
        One number per tensor.
    """
    arrays = [dr.detach(value).array for value in values]
    size = dr.width(arrays[0])
    lane, joined = dr.arange(mi.UInt32, size), dr.empty(mi.Float, size * len(arrays))
    for k, array in enumerate(arrays):
        dr.scatter(joined, array, lane + k * size)
    total = dr.block_sum(joined, size)
    return [dr.gather(mi.Float, total, mi.UInt32(k)) for k in range(len(arrays))]


WeightCopy = tuple[Tensors, Tensors, tuple[Tensors, ...]]
"""Weights, their average, and both moments."""


class Learner:
    """Weights, their average, Adam's moments, and the step counters of both."""

    def __init__(self, model: Model, settings: TrainingSettings, seed: int) -> None:
        """Initialise the weights.

        Args:
            model: Network.
            settings: Settings of the optimiser.
            seed: Seed of the weights.
        """
        self.model, self.settings = model, settings
        initial = model.initial(seed)
        self.values: Tensors = tensors(initial)
        """Raw weights."""
        self.average: Tensors = tensors({k: np.zeros_like(v) for k, v in initial.items()})
        """Averaged weights; equal to the raw ones before the first step."""
        self.moments: tuple[Tensors, ...] = tuple(
            tensors({k: np.zeros_like(v) for k, v in initial.items()}) for _ in range(2)
        )
        self.step = 0
        """Gradient steps taken, t of Adam's bias correction."""
        self.averaged = 0
        """Gradient steps in the average; reset by ``forget``."""
        self.copy: WeightCopy | None = None
        """Last copy of finite weights, see ``keep``."""
        self.rollbacks = 0
        """Number of times that the copy was restored."""

    @property
    def shown(self) -> Tensors:
        """Return the weights that rendering paths evaluate.

        Returns:
            Averaged weights; the raw ones before the first step or without averaging.
        """
        return self.average if self.averaged and self.settings.ema_decay else self.values

    def keep(self) -> None:
        """Copy the weights, so that ``restore`` can return to them."""
        self.copy = (dict(self.values), dict(self.average), tuple(dict(m) for m in self.moments))

    def restore(self) -> bool:
        """Return to the last copy of the weights.

        Returns:
            False when there is no copy.
        """
        if self.copy is None:
            return False
        values, average, moments = self.copy
        self.values, self.average, self.moments = dict(values), dict(average), tuple(dict(m) for m in moments)
        self.rollbacks += 1
        return True

    def forget(self) -> None:
        """Restart the average from the raw weights, after a change of the scene."""
        self.average = {k: mi.TensorXf(v) for k, v in self.values.items()}
        self.averaged = 0

    def train(self, batch: Batch, start: int, rate: float) -> Any:
        """Take one gradient step on ``settings.batch`` rows.

        Args:
            batch: Records on the device.
            start: First row.
            rate: Learning rate, > 0.

        Returns:
            Loss and mean signed residual as one two-dimensional point on the device.
        """
        self.step += 1
        self.averaged += 1
        new, old = averaging(self.settings.step_decay, self.averaged, self.settings.early_average)
        correction = (1 - BETA_2**self.step) ** 0.5 / (1 - BETA_1**self.step)
        numbers = [dr.opaque(mi.Float, x) for x in (rate * correction, new, old)]
        step = _frozen_step(self.model, self.settings.batch, self.settings.target_cap)
        first = dr.opaque(mi.UInt32, start)
        self.values, self.average, self.moments, stats = step(
            self.values, self.average, self.moments, batch.direct, batch.points, batch.target, batch.weight, first,
            *numbers,
        )  # fmt: skip
        dr.eval(self.values, self.average, self.moments, stats)
        return stats

    def rescale(self, k: float) -> None:
        """Multiply the network's output by a factor, exactly: the last layer is linear. Moments and the copy follow.

        Args:
            k: Factor, > 0.
        """
        last, held = self.model.last, [(self.values, self.average, self.moments)]
        if self.copy is not None:
            held.append(self.copy)  # It may be restored after the change of scale.
        for values, average, (first, second) in held:
            for tensors_, factor in ((values, k), (average, k), (first, 1 / k), (second, 1 / k**2)):
                tensors_[last] = mi.TensorXf(tensors_[last].array * dr.opaque(mi.Float, factor), tensors_[last].shape)
                dr.eval(tensors_[last])


@functools.lru_cache(maxsize=64)
def _frozen_step(model: Model, count: int, cap: float) -> Any:
    """Return one optimiser step as a frozen function, cached for the life of the process."""

    def step(
        values: Tensors, average: Tensors, moments: tuple[Tensors, ...], direct: Any, points: Any, target: Any,
        weight: Any, start: mi.UInt32, rate: mi.Float, new: mi.Float, old: mi.Float,
    ) -> tuple[Any, ...]:  # fmt: skip
        x, p, y, w = (_rows(t, start, count) for t in (direct, points, target, weight))
        values = {name: mi.TensorXf(value) for name, value in values.items()}
        with dr.resume_grad():  # mi.render suspends derivatives
            dr.enable_grad(values)
            output = model.forward(values, x, p)
            y = believed(output, y, cap)
            terms = loss(output, y, w)
            residual = (dr.maximum(dr.detach(output), 0) - y) * w
            total, signed, weights = sums(terms, residual, w)
            share = 1 / dr.maximum(weights, 1)
            dr.backward(terms.array * share)
            gradients = {name: dr.grad(value) for name, value in values.items()}
        values = {name: dr.detach(value) for name, value in values.items()}
        stats = mi.Point2f(total * share, signed * share)
        return *_updated(values, average, moments, gradients, rate, new, old), stats

    return freeze(step)


def _updated(
    values: Tensors, average: Tensors, moments: tuple[Tensors, ...], gradients: Tensors, rate: mi.Float, new: mi.Float,
    old: mi.Float,
) -> tuple[Tensors, Tensors, tuple[Tensors, ...]]:  # fmt: skip
    """Update Adam and the average; weights whose gradient is not finite stay as they are."""
    values_: Tensors = {}
    average_: Tensors = {}
    first_: Tensors = {}
    second_: Tensors = {}
    for name, value in values.items():
        g, v, shape = gradients[name].array, value.array, value.shape
        m1, m2 = moments[0][name].array, moments[1][name].array
        moves = dr.isfinite(g)
        ε = EPSILON
        if name == "table":
            moves &= g != 0  # Entries that no record reads stay as they are.
            ε = TABLE_EPSILON
        else:
            g = g + DECAY * v
        a = dr.select(moves, BETA_1 * m1 + (1 - BETA_1) * g, m1)
        b = dr.select(moves, BETA_2 * m2 + (1 - BETA_2) * dr.square(g), m2)
        v = dr.select(moves, v - rate * a / (dr.sqrt(b) + ε), v)
        e = new * v + old * average[name].array
        for store, array in ((values_, v), (first_, a), (second_, b), (average_, e)):
            store[name] = mi.TensorXf(array, shape)
    return values_, average_, (first_, second_)


def _rows(table: Any, start: Any, count: int) -> Any:
    """[count, F] rows from row ``start`` on."""
    width = table.shape[1]
    lane = dr.arange(mi.UInt32, count * width) + start * width
    return mi.TensorXf(dr.gather(mi.Float, table.array, lane), (count, width))
