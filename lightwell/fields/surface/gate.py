"""Gates of experts: a small network whose largest output names the expert."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.graph import Builder
from lightwell.networks import Mlp

# An expert with less than this share of an equal share of the samples counts as dead.
DEAD_SHARE = 1e-3


def choose(gate: Mlp, weights: dict[str, np.ndarray], features: np.ndarray) -> np.ndarray:
    """[N] int expert of each row; the gate's last layer is linear, because argmax does not see a monotone function."""
    return gate.evaluate(weights, features).argmax(axis=1)


def lower_choice(b: Builder, gate: Mlp, weights: dict[str, np.ndarray], x: str) -> str:
    """The same as nodes of a graph; returns the expert's number, width 1."""
    for k in range(gate.layers):
        x = b.linear(x, weights[f"w{k}"].T, weights[f"b{k}"][0])
        x = b.activate(x, gate.activation) if k + 1 < gate.layers else x
    return b.slice(b.top2(x), 0, 1)


def shares(segment: np.ndarray, experts: int) -> np.ndarray:
    """[M] share of the rows that each expert has."""
    return np.bincount(segment, minlength=experts) / max(len(segment), 1)


def entropy(p: np.ndarray) -> float:
    """Mean over rows of −Σ p ln p, in nats; p [N, M] or [M]."""
    p = np.maximum(np.atleast_2d(p), 1e-12)
    return float(-(p * np.log(p)).sum(axis=1).mean())


def softmax(z: np.ndarray) -> np.ndarray:
    """[N, M] probabilities."""
    e = np.exp(z - z.max(axis=1, keepdims=True))
    return e / e.sum(axis=1, keepdims=True)


def share_facts(segment: np.ndarray, experts: int) -> dict[str, Any]:
    """How the experts share the training samples, as JSON values."""
    share = shares(segment, experts)
    dead = np.flatnonzero(share < DEAD_SHARE / experts)
    return {"experts": experts, "share": [round(float(s), 4) for s in share], "dead": dead.tolist()}


def append(curves: dict[str, list], **values: Any) -> None:
    """Add one point to every named curve."""
    for name, value in values.items():
        curves.setdefault(name, []).append(value)
