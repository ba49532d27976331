"""The generator: one evaluation of a small network from a sampled weight function to the parameters that show it.

    c = (ρ - mean) · components        h ← h + leaky(W h + b)        parameters = W h + b

The samples are those of the pattern, weighed by the hat; the components are their principal ones. The network was
trained by ``tools/train_probe_generator.py`` on made-up rooms, through the decoder: its error is that of the weights,
never that of parameters (hidden units that change places give one function many parameters). What it finds is a start:
a few local steps follow. Without the file, or for another pattern, every function is fitted from scratch.

Notation: B probes, Q points, K components, H width, C parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from lightwell.files import load_arrays, save_arrays
from lightwell.graph.ops.activate import LEAK
from lightwell.probes.pattern import Pattern, pattern
from lightwell.probes.weights import FUNCTIONS, Close, TinyMlp, error, trusted
from lightwell.probes.weights import refine as descend
from lightwell.probes.weights.common import INSIDE_WEIGHT

FILE = Path(__file__).with_name("generator.npz")
# Largest file that is read, and largest number in it.
MOST_BYTES, LARGEST = 4 << 20, 1e4
# Local steps after the network: Newton's for a grid, Adam's (with their rate) for a network.
NEWTON, ADAM, RATE = 10, 50, 0.003
# A network whose hat-weighted RMSE is still above this goes on for so many steps, of fewer points each: steps count,
# not points (RMSE over that of 2,500 steps of 1,024 points from scratch, 16 probes of S2: 1,300 steps of 512 1.7,
# 1,600 of 384 1.06, 1,900 of 256 0.99, 2,400 of 512 0.58 in one and a half times of the time).
GATE, MORE, MORE_POINTS, MORE_RATE = 0.004, 1900, 256, 0.01


@dataclass(frozen=True)
class Generator:
    """Principal components, and a network for each weight function."""

    mean: np.ndarray
    """[Q] mean of hat · ρ."""
    components: np.ndarray
    """[Q, K]."""
    networks: dict[str, list[np.ndarray]]
    """By weight function: W [in, out] and b [out] of each layer."""

    def __call__(self, function: str, target: np.ndarray, layout: Pattern) -> np.ndarray:
        """[B, C] parameters for targets [B, Q]."""
        x = (target * layout.hat.astype(np.float32) - self.mean) @ self.components
        return run(self.networks[function], x)[0]

    def save(self, path: Path) -> None:
        """Components as bytes with a step each, layers as half floats."""
        step = np.abs(self.components).max(axis=0) / 127
        arrays = {"mean": self.mean.astype(np.float16), "step": step.astype(np.float32)}
        arrays["components"] = np.rint(self.components / step).astype(np.int8)
        for name, layers in self.networks.items():
            arrays |= {f"{name}.{k}": layer.astype(np.float16) for k, layer in enumerate(layers)}
        save_arrays(path, arrays, compressed=True)


def run(layers: list[np.ndarray], x: np.ndarray) -> tuple[np.ndarray, list]:
    """Output [B, C] of inputs [B, K], and what a gradient needs: inputs and slopes of each layer."""
    kept, count = [], len(layers) // 2
    for k in range(count):
        w, b = layers[2 * k : 2 * k + 2]
        z = x @ w + b
        last = k + 1 == count
        steep = None if last else np.where(z > 0, np.float32(1), np.float32(LEAK))
        kept.append((x, steep))
        y = z if last else z * steep
        # Residual wherever the widths agree.
        x = y if last or k == 0 else x + y
    return x, kept


def load(path: Path = FILE) -> Generator | None:
    """The generator of a file; None where there is none.

    Raises ``ValueError`` for a file that is not one: sizes, types and numbers are checked before use.
    """
    if not path.is_file():
        return None
    wrong = f"{path}: not a probe generator; run tools/train_probe_generator.py, or delete it to fit without one"
    if path.stat().st_size > MOST_BYTES:
        raise ValueError(wrong)
    try:
        arrays = {name: value.astype(np.float32) for name, value in load_arrays(path).items()}
        components = arrays["components"] * arrays["step"]
        names = sorted({name.rsplit(".", 1)[0] for name in arrays if "." in name})
        networks = {name: [arrays[f"{name}.{k}"] for k in range(_count(arrays, name))] for name in names}
        good = all(_fits(networks[name], components.shape[1], FUNCTIONS[name].parameters) for name in names)
        good &= all(np.isfinite(a).all() and np.abs(a).max(initial=0) < LARGEST for a in arrays.values())
        good &= arrays["mean"].shape == components.shape[:1]
    except (KeyError, ValueError, TypeError, OSError, IndexError) as error:
        raise ValueError(wrong) from error
    if not good:
        raise ValueError(wrong)
    return Generator(arrays["mean"], components, networks)


def _count(arrays: dict, name: str) -> int:
    return sum(key.rsplit(".", 1)[0] == name for key in arrays if "." in key)


def _fits(layers: list[np.ndarray], width: int, parameters: int) -> bool:
    """Whether each layer takes what the one before gives."""
    for k, (w, b) in enumerate(zip(layers[::2], layers[1::2])):
        last = 2 * k + 2 == len(layers)
        if w.ndim != 2 or w.shape[0] != width or b.shape != w.shape[1:] or (0 < k and not last and w.shape[1] != width):
            return False
        width = w.shape[1]
    return len(layers) % 2 == 0 and width == parameters


@lru_cache(maxsize=1)
def _shipped() -> Generator | None:
    return load()


def fit_with(function: str, generator: Generator | None = None, refine: bool = True) -> Callable | None:
    """A fit (target, weight, pattern, close) → parameters that starts from the generator and, with ``refine``, goes on
    probe by probe; None where it knows nothing of this function, or there is none."""
    made = generator or _shipped()
    if made is None or function not in made.networks:
        return None
    f = FUNCTIONS[function]

    def fit(target: np.ndarray, weight: np.ndarray, layout: Pattern, close: Close | None = None) -> np.ndarray:
        if len(layout.u) != len(made.mean) or layout is not pattern():
            return f.fit(target, weight, layout, close)
        start = made(function, target, layout)
        if not refine:
            return f.bounded(start)
        if isinstance(f, TinyMlp):
            found = descend(f, start, target, weight, layout, steps=ADAM, rate=RATE, close=close)
            return _gated(f, found, target, weight, layout, close)
        return f.convex(target, weight, layout, close, start=start, steps=NEWTON)

    return fit


def _gated(f: TinyMlp, found: np.ndarray, target, weight, layout: Pattern, close: Close | None) -> np.ndarray:
    """Networks that are good enough, and the others after more steps."""
    rho = trusted(f.values(f.quantised(found), layout.u)[0])
    # Points inside geometry weigh next to nothing, and are not asked.
    asked = weight > 2 * INSIDE_WEIGHT * layout.hat.astype(np.float32) ** 2
    rows = np.flatnonzero(error(target, rho, layout.hat, asked) > GATE)
    if len(rows):
        near = close and Close(close.u[rows], close.target[rows], close.weight[rows])
        steps = dict(steps=MORE, rate=MORE_RATE, points=MORE_POINTS, close=near)
        found[rows] = descend(f, found[rows], target[rows], weight[rows], layout, **steps)
    return found
