"""Gates of experts: a small network whose largest output selects the expert. N rows, M experts."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.fields.surface.lowering import graph_layers
from lightwell.graph import Builder
from lightwell.graph.layers import add_layers
from lightwell.networks import Mlp

# An expert with less than this share of an equal share of the samples counts as dead.
DEAD_SHARE = 1e-3


def choose(gate: Mlp, weights: dict[str, np.ndarray], features: np.ndarray) -> np.ndarray:
    """Select the expert of each row.

    Args:
        gate: Shape of the gate; its last layer is linear, because a monotone activation does not change the argmax.
        weights: Weights [in, out] and biases [1, out] of the gate by name.
        features: [N, F] inputs of the gate.

    Returns:
        [N] int expert.
    """
    return gate.evaluate(weights, features).argmax(axis=1)


def lower_choice(b: Builder, gate: Mlp, weights: dict[str, np.ndarray], x: str) -> str:
    """Add ``choose`` to a graph.

    Args:
        b: Graph to add nodes to.
        gate: Shape of the gate.
        weights: Weights [in, out] and biases [1, out] of the gate by name.
        x: Name of the node with the F inputs.

    Returns:
        Name of the node with the expert's number, width 1.
    """
    activations = (gate.activation,) * (gate.layers - 1) + (None,)
    return b.slice(b.top2(add_layers(b, x, graph_layers(weights, range(gate.layers)), activations)), 0, 1)


def shares(segment: np.ndarray, experts: int) -> np.ndarray:
    """Compute the share of the rows that each expert has.

    Args:
        segment: [N] int expert of each row.
        experts: M.

    Returns:
        [M] shares in [0, 1].
    """
    return np.bincount(segment, minlength=experts) / max(len(segment), 1)


def entropy(p: np.ndarray) -> float:
    """Compute the mean entropy of distributions.

    Args:
        p: [N, M] or [M] probabilities.

    Returns:
        Mean over rows of −Σ p ln p, in nats.
    """
    p = np.maximum(np.atleast_2d(p), 1e-12)
    return float(-(p * np.log(p)).sum(axis=1).mean())


def softmax(z: np.ndarray) -> np.ndarray:
    """Compute probabilities from logits.

    Args:
        z: [N, M] logits.

    Returns:
        [N, M] probabilities.
    """
    e = np.exp(z - z.max(axis=1, keepdims=True))
    return e / e.sum(axis=1, keepdims=True)


def share_facts(segment: np.ndarray, experts: int) -> dict[str, Any]:
    """Summarise how the training samples are shared among the experts.

    Args:
        segment: [N] int expert of each sample.
        experts: M.

    Returns:
        JSON values: number of experts, share of each, and those with almost no samples.
    """
    share = shares(segment, experts)
    dead = np.flatnonzero(share < DEAD_SHARE / experts)
    return {"experts": experts, "share": [round(float(s), 4) for s in share], "dead": dead.tolist()}


def append(curves: dict[str, list[Any]], **values: Any) -> None:
    """Append a point to each named curve.

    Args:
        curves: Curves by name; changed in place.
        **values: Value to append, by name of the curve.
    """
    for name, value in values.items():
        curves.setdefault(name, []).append(value)
