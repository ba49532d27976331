"""The generator: predicts the parameters of a weight function from its samples with one evaluation of a small network.

    c = (ρ - mean) · components        h ← h + leaky(W h + b)        parameters = W h + b

The samples are those at the points of the pattern, multiplied by the hat; ``components`` are their principal
components. The network was trained by ``tools/train_probe_generator.py`` on generated rooms, through the decoder:
its loss is the error of the weights, not of the parameters (permuted hidden units give one function many
parameters). Its output is a start for a few local optimisation steps. Without the file, or with another pattern,
every function is fitted from scratch.

Notation: B probes, Q points, K components, H width, C parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.files import load_arrays, save_arrays
from lightwell.graph.ops.activate import LEAK
from lightwell.probes.pattern import Pattern, pattern
from lightwell.probes.weights import FUNCTIONS, Close, Fit, TinyMlp, error, trusted
from lightwell.probes.weights import refine as descend
from lightwell.probes.weights.common import INSIDE_WEIGHT

FILE = Path(__file__).with_name("generator.npz")
# Largest file that is read, and largest number in it.
MOST_BYTES, LARGEST = 4 << 20, 1e4
# Local optimisation steps after the network: Newton steps for a grid; Adam steps and their rate for a network.
NEWTON, ADAM, RATE = 10, 50, 0.003
# Where the hat-weighted RMSE is still above GATE, a network is also optimised from random parameters, by MORE steps
# with fewer points each, and the better one is kept: those of the generator lie near a worse minimum there. RMSE over
# that of 2,500 steps of 1,024 points from random parameters (16 probes of S2, 24 each of S3 and S4): 0.90, 1.02, 1.10;
# as many steps from the generator's 2.44, 1.48, 1.71, and with twice the points 2.32, 1.68, 0.92.
GATE, MORE, MORE_POINTS, MORE_RATE = 0.002, 1900, 256, 0.02


@dataclass(frozen=True)
class Generator:
    """Principal components of targets, and a network for each weight function."""

    mean: np.ndarray
    """[Q] mean of hat · ρ over the training set."""
    components: np.ndarray
    """[Q, K] principal components of hat · ρ."""
    networks: dict[str, list[np.ndarray]]
    """Weights [in, out] and bias [out] of each layer in turn, by weight function."""

    def __call__(self, function: str, target: np.ndarray, layout: Pattern) -> np.ndarray:
        """Predict parameters.

        Args:
            function: Name of the weight function, one of ``networks``.
            target: [B, Q] trust at the points of the pattern.
            layout: The pattern for which the generator was trained.

        Returns:
            [B, C] parameters.
        """
        x = (target * layout.hat.astype(np.float32) - self.mean) @ self.components
        return run(self.networks[function], x)[0]

    def save(self, path: Path) -> None:
        """Write the generator: components as bytes with one step each, layers as float16.

        Args:
            path: File to write.
        """
        step = np.abs(self.components).max(axis=0) / 127
        arrays = {"mean": self.mean.astype(np.float16), "step": step.astype(np.float32)}
        arrays["components"] = np.rint(self.components / step).astype(np.int8)
        for name, layers in self.networks.items():
            arrays |= {f"{name}.{k}": layer.astype(np.float16) for k, layer in enumerate(layers)}
        save_arrays(path, arrays, compressed=True)


def run(layers: list[np.ndarray], x: np.ndarray) -> tuple[np.ndarray, list]:
    """Evaluate a residual network.

    Args:
        layers: Weights [in, out] and bias [out] of each layer in turn.
        x: [B, K] inputs.

    Returns:
        [B, C] outputs, and per layer what the gradient needs: its input and the slope of its activation.
    """
    kept, count = [], len(layers) // 2
    for k in range(count):
        w, b = layers[2 * k : 2 * k + 2]
        z = x @ w + b
        last = k + 1 == count
        steep = None if last else np.where(z > 0, np.float32(1), np.float32(LEAK))
        kept.append((x, steep))
        y = z if last else z * steep
        # Hidden layers are residual.
        x = y if last or k == 0 else x + y
    return x, kept


def load(path: Path = FILE) -> Generator | None:
    """Read a generator; sizes, types and numbers are checked before use.

    Args:
        path: File to read.

    Returns:
        The generator, or None when the file does not exist.

    Raises:
        ValueError: The file is not a generator.
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


def _count(arrays: dict[str, Any], name: str) -> int:
    return sum(key.rsplit(".", 1)[0] == name for key in arrays if "." in key)


def _fits(layers: list[np.ndarray], width: int, parameters: int) -> bool:
    """Whether the widths of consecutive layers agree."""
    for k, (w, b) in enumerate(zip(layers[::2], layers[1::2])):
        last = 2 * k + 2 == len(layers)
        if w.ndim != 2 or w.shape[0] != width or b.shape != w.shape[1:] or (0 < k and not last and w.shape[1] != width):
            return False
        width = w.shape[1]
    return len(layers) % 2 == 0 and width == parameters


@lru_cache(maxsize=1)
def _shipped() -> Generator | None:
    return load()


def fit_with(function: str, generator: Generator | None = None, refine: bool = True) -> Fit | None:
    """Return a fit that starts from the output of the generator.

    Args:
        function: Name of the weight function.
        generator: The generator; None for the one in the package.
        refine: Continue with local optimisation steps for each probe.

    Returns:
        The fit, or None when there is no generator or it has no network for the function.
    """
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
    """The parameters, or better ones from random parameters for networks whose error is above ``GATE``."""
    # Points inside geometry have a tiny weight; the error leaves them out.
    asked = weight > 2 * INSIDE_WEIGHT * layout.hat.astype(np.float32) ** 2

    def errors(params: np.ndarray, rows: np.ndarray) -> np.ndarray:
        rho = trusted(f.values(f.quantised(params), layout.u)[0])
        return error(target[rows], rho, layout.hat, asked[rows])

    of_found = errors(found, np.arange(len(found)))
    rows = np.flatnonzero(of_found > GATE)
    if len(rows):
        near = close and Close(close.u[rows], close.target[rows], close.weight[rows])
        steps = dict(steps=MORE, rate=MORE_RATE, points=MORE_POINTS, close=near)
        other = descend(f, f.initial(len(found))[rows], target[rows], weight[rows], layout, **steps)
        better = errors(other, rows) < of_found[rows]
        found[rows[better]] = other[better]
    return found
