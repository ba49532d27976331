"""How fast a shading graph runs in Dr.Jit, against this machine's own matrix product.

    python benchmarks/inference_rate.py

All are measured in turns in one run, so that the ratios mean the same on every machine. One multiply-add counts as two
operations; activations are free work on top.

Expect 0.3 to 0.5 of the matrix product on a CPU with AVX2: the cooperative vectors of Dr.Jit 1.5 keep their
accumulators in memory, with one store per multiply-add. Layers split into blocks, unrolled literals, wider packets and
chunked matrix products were tried and are no faster.
"""

from __future__ import annotations

import argparse
import platform
import time
from itertools import pairwise

import numpy as np

from lightwell.backend import ACTIVE, dr, mi
from lightwell.graph import Builder, Graph, compile

# The network of the bar: four layers of 64, three outputs.
SIZES = (64, 64, 64, 64, 3)
ROUNDS = 7


def network(sizes: tuple[int, ...] = SIZES, function: str = "relu", seed: int = 0) -> Graph:
    """A multi-layer perceptron with random weights that keep the values near 1."""
    rng, b = np.random.default_rng(seed), Builder(x=sizes[0])
    value = "x"
    for i, (inputs, outputs) in enumerate(pairwise(sizes)):
        weights = rng.normal(0, inputs**-0.5, (outputs, inputs))
        value = b.linear(value, weights, rng.normal(0, 0.1, outputs))
        value = b.activate(value, function) if i + 2 < len(sizes) else value
    return b.build(y=value)


def _seconds(work) -> tuple[float, float]:
    """Wall and processor seconds of a piece of work."""
    wall, processor = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - processor


def measure(points: int = 1 << 20, sizes: tuple[int, ...] = SIZES, function: str = "relu", size: int = 1024) -> dict:
    """GFLOP/s of the network and of a float32 matrix product; ratios to the latter.

    The ratio of processor seconds is the one to trust on a machine that does other things as well.
    """
    graph = network(sizes, function)
    compiled = compile(graph)
    x = dr.arange(mi.Float, points) * (1 / points)
    inputs = {"x": [x * (i + 1) - i * 0.5 for i in range(sizes[0])]}
    dr.eval(inputs)
    a = np.random.default_rng(1).random((size, size), np.float32)

    def kernel() -> None:
        dr.eval(compiled(inputs))
        dr.sync_thread()

    work = {"kernel": kernel, "sgemm": lambda: a @ a}
    operations = {"kernel": 2 * graph.macs * points, "sgemm": 2 * size**3}
    for run in work.values():
        run()
    times = {name: [] for name in work}
    for _ in range(ROUNDS):
        for name, run in work.items():
            times[name].append(_seconds(run))
    wall = {name: operations[name] / min(t[0] for t in times[name]) / 1e9 for name in work}
    processor = {name: operations[name] / min(t[1] for t in times[name]) / 1e9 for name in work}
    return {
        "machine": platform.processor() or platform.machine(),
        "variant": ACTIVE.variant,
        "threads": ACTIVE.threads,
        "drjit": dr.__version__,
        "numpy": np.__version__,
        "network": "-".join(map(str, sizes)) + f" {function}",
        "points": points,
        "macs": graph.macs,
        "gflops": wall["kernel"],
        "sgemm_gflops": wall["sgemm"],
        "ratio": wall["kernel"] / wall["sgemm"],
        "ratio_processor": processor["kernel"] / processor["sgemm"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1 << 20)
    for function in ("relu", "silu"):
        for sizes in (SIZES, (12, 20, 10, 3)):
            result = measure(parser.parse_args().points, sizes, function)
            print(", ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in result.items()))


if __name__ == "__main__":
    main()
