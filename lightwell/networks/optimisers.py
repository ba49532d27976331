"""Optimiser steps as pure functions on dicts of tensors, so that they can be part of a frozen kernel.

Dr.Jit's own ``drjit.opt.Adam`` (1.5) multiplies a learning rate given as an array in place, once per parameter, so that
the rate drifts with every step; and a rate given as a number would be compiled into the kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from lightwell.backend import dr, mi

Tensors = dict[str, Any]

# Decay of the moments and the term that keeps the division finite (Kingma & Ba 2015, their defaults).
BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-8
# For hash grids (Müller et al. 2022): the gradients of a table's rows are rare and small, and a training is short.
GRID_BETA_2, GRID_EPSILON = 0.99, 1e-15


def adam(
    values: Tensors,
    gradients: Tensors,
    moments: tuple[Tensors, Tensors],
    rate: Any,
    beta_2: float = BETA_2,
    epsilon: float = EPSILON,
) -> tuple[Tensors, Any]:
    """Do one Adam step (Kingma & Ba 2015).

    Args:
        values: Parameters by name.
        gradients: Their gradients.
        moments: First and second moments.
        rate: Learning rate with the bias correction of ``adam_rate``.
        beta_2: Decay of the second moment, in (0, 1).
        epsilon: Term that keeps the division finite, > 0.

    Returns:
        New values and moments.
    """
    first = {k: BETA_1 * moments[0][k] + (1 - BETA_1) * g for k, g in gradients.items()}
    second = {k: beta_2 * moments[1][k] + (1 - beta_2) * dr.square(g) for k, g in gradients.items()}
    moved = {k: values[k] - mi.TensorXf(rate) * first[k] / (dr.sqrt(second[k]) + epsilon) for k in values}
    return moved, (first, second)


def adam_rate(rate: float, step: int, beta_2: float = BETA_2) -> float:
    """Multiply the learning rate by both bias corrections of Adam.

    Args:
        rate: Learning rate.
        step: Number of the step, ≥ 1.
        beta_2: Decay of the second moment.

    Returns:
        Corrected rate.
    """
    return rate * (1 - beta_2**step) ** 0.5 / (1 - BETA_1**step)


def sgd(values: Tensors, gradients: Tensors, moments: tuple[Tensors, Tensors], rate: Any) -> tuple[Tensors, Any]:
    """Do one step of plain gradient descent.

    Args:
        values: Parameters by name.
        gradients: Their gradients.
        moments: Returned unchanged.
        rate: Learning rate.

    Returns:
        New values, and the moments.
    """
    return {k: values[k] - mi.TensorXf(rate) * gradients[k] for k in values}, moments


def sgd_rate(rate: float, step: int) -> float:
    """Return the learning rate unchanged.

    Args:
        rate: Learning rate.
        step: Not used.

    Returns:
        ``rate``.
    """
    return rate


# Update and rate by name.
OPTIMISERS: dict[str, tuple[Callable[..., Any], Callable[[float, int], float]]] = {
    "adam": (adam, adam_rate),
    "adam_grid": (partial(adam, beta_2=GRID_BETA_2, epsilon=GRID_EPSILON), partial(adam_rate, beta_2=GRID_BETA_2)),
    "sgd": (sgd, sgd_rate),
}
