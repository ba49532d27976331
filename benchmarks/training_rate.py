"""Seconds per training step of our network beside the same network in NumPy (BLAS) and, where it is installed, JAX.

    python benchmarks/training_rate.py

Same sizes, batch, loss and optimiser (Adam), measured in turns in one run; medians. Then a step of the default field
in a scene with glossy surfaces.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from lightwell.backend import dr
from lightwell.fields.surface.factored import PRESETS
from lightwell.networks import Mlp, Trainer, TrainingSet, TrainingSettings
from lightwell.networks.factored import FactoredNetwork
from lightwell.networks.light_major import LightMajorSet

# The field `mlp`: 85 features, two hidden layers of 64.
SIZES = (85, 64, 64, 3)
BATCH, ROWS = 1 << 12, 1 << 17
STEPS = 60


def _data(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((ROWS, SIZES[0])).astype(np.float32)
    return x, (0.2 + rng.random((ROWS, 3))).astype(np.float32)


def ours(x: np.ndarray, y: np.ndarray) -> Callable[[], None]:
    """STEPS steps of the trainer that bakes use."""
    trainer = Trainer(Mlp(SIZES), TrainingSettings(batch=BATCH, clip=0.0), 0)
    data = TrainingSet.from_numpy(x, y, np.ones(ROWS))

    def run() -> None:
        for _ in range(STEPS):
            trainer.step(data, 10_000)
        dr.sync_thread()

    return run


def numpy_blas(x: np.ndarray, y: np.ndarray) -> Callable[[], None]:
    """The same steps with matrix products in BLAS, written out by hand."""
    weights = {k: v.copy() for k, v in Mlp(SIZES).initial(0).items()}
    first, second = ({k: np.zeros_like(v) for k, v in weights.items()} for _ in range(2))
    step = 0

    def forward_backward(a: np.ndarray, target: np.ndarray) -> dict[str, np.ndarray]:
        inputs, sigmoids, sums = [a], [], []
        for k in range(len(SIZES) - 1):
            z = inputs[-1] @ weights[f"w{k}"] + weights[f"b{k}"]
            if k + 2 < len(SIZES):
                s = 1 / (1 + np.exp(-z))
                sigmoids.append(s)
                sums.append(z)
                inputs.append(z * s)
        f = np.exp(np.clip(z, -12, 6))
        g = 2 * (f - target) / (f * f + 0.0025) * f / f.size
        gradients = {}
        for k in reversed(range(len(SIZES) - 1)):
            gradients[f"w{k}"], gradients[f"b{k}"] = inputs[k].T @ g, g.sum(0, keepdims=True)
            if k:
                s, z = sigmoids[k - 1], sums[k - 1]
                g = (g @ weights[f"w{k}"].T) * (s * (1 + z * (1 - s)))
        return gradients

    def run() -> None:
        nonlocal step
        for _ in range(STEPS):
            start = step * BATCH % ROWS
            step += 1
            for k, g in forward_backward(x[start : start + BATCH], y[start : start + BATCH]).items():
                first[k] = 0.9 * first[k] + 0.1 * g
                second[k] = 0.999 * second[k] + 0.001 * g * g
                weights[k] -= 1e-4 * first[k] / (np.sqrt(second[k]) + 1e-8)

    return run


def jax_xla(x: np.ndarray, y: np.ndarray) -> Callable[[], None] | None:
    """The same steps in JAX; None where it is not installed."""
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        return None
    weights = {k: jnp.asarray(v) for k, v in Mlp(SIZES).initial(0).items()}
    state = (weights, jax.tree.map(jnp.zeros_like, weights), jax.tree.map(jnp.zeros_like, weights))
    table, target = jnp.asarray(x), jnp.asarray(y)

    def loss(w, a, t):
        for k in range(len(SIZES) - 1):
            a = a @ w[f"w{k}"] + w[f"b{k}"]
            a = jax.nn.silu(a) if k + 2 < len(SIZES) else jnp.exp(jnp.clip(a, -12, 6))
        return jnp.mean((a - t) ** 2 / (jax.lax.stop_gradient(a) ** 2 + 0.0025))

    @jax.jit
    def step(state, start):
        w, m, v = state
        a = jax.lax.dynamic_slice_in_dim(table, start, BATCH)
        t = jax.lax.dynamic_slice_in_dim(target, start, BATCH)
        g = jax.grad(loss)(w, a, t)
        m = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, m, g)
        v = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g * g, v, g)
        w = jax.tree.map(lambda w, m, v: w - 1e-4 * m / (jnp.sqrt(v) + 1e-8), w, m, v)
        return w, m, v

    def run() -> None:
        nonlocal state
        for k in range(STEPS):
            state = step(state, k * BATCH % ROWS)
        jax.block_until_ready(state)

    return run


def measure(rounds: int = 7) -> dict:
    """Median milliseconds per step of each, and our time over the faster of the others."""
    x, y = _data()
    runs = {"lightwell": ours(x, y), "numpy": numpy_blas(x, y), "jax": jax_xla(x, y)}
    runs = {name: run for name, run in runs.items() if run}
    times: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(rounds + 1):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            if turn:  # the first turn compiles
                times[name].append((time.perf_counter() - start) / STEPS)
    median = {name: statistics.median(values) for name, values in times.items()}
    fastest = min(value for name, value in median.items() if name != "lightwell")
    return {"milliseconds": {k: 1e3 * v for k, v in median.items()}, "ratio": median["lightwell"] / fastest}


def default_field(rounds: int = 7) -> float:
    """Median milliseconds per step of the field that bakes train by default, 64 lights of 128 rows each."""
    preset, rng = PRESETS["default"], np.random.default_rng(0)
    pixel, frame, lights, rows = 19, 33, 512, 128
    hidden = preset.glossy_hidden or preset.hidden
    network = FactoredNetwork(preset.grid, pixel, frame, preset.light_hidden, hidden, preset.mirror)
    many = lights * rows
    points, inputs = rng.random((many, 7)).astype(np.float32), rng.standard_normal((many, pixel)).astype(np.float32)
    light, target = rng.standard_normal((lights, frame)).astype(np.float32), 0.2 + rng.random((many, 3))
    data = LightMajorSet.of(points, inputs, light, target.astype(np.float32), np.ones((many, 1), np.float32))
    trainer = Trainer(network, preset.training, 0)
    times = []
    for turn in range(rounds + 1):
        start = time.perf_counter()
        for _ in range(STEPS):
            trainer.step(data, 10_000)
        dr.sync_thread()
        if turn:
            times.append((time.perf_counter() - start) / STEPS)
    return 1e3 * statistics.median(times)


if __name__ == "__main__":
    result = measure()
    print({k: round(v, 2) for k, v in result["milliseconds"].items()}, "ms per step; ratio", round(result["ratio"], 2))
    print(round(default_field(), 2), "ms per step of the default field")
