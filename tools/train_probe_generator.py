"""Trains the generator of light probes on made-up rooms and writes lightwell/probes/generator.npz.

python tools/train_probe_generator.py [--rooms 240] [--steps 6000] [--seed 1] [--quick]

Rooms are boxes of one to four rooms with doorways, windows, slabs, columns and tilted sheets. One room in eight is held
out whole; the figures are of those. A few minutes on two cores. The weights are ours, under the project's licence.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from time import perf_counter

import numpy as np
from leak_scenes import WHITE, _block, _finish, _kit

from lightwell.probes.assemble import close_points
from lightwell.probes.bake import bake_geometry
from lightwell.probes.generator import FILE, Generator, fit_with, load, run
from lightwell.probes.pattern import pattern
from lightwell.probes.support import cube_valid
from lightwell.probes.volume import WEIGHTED
from lightwell.probes.weights import FUNCTIONS, error, leak, point_weight, trusted, under
from lightwell.scenes.builtin.shapes import box

COMPONENTS, WIDTH, LAYERS, BATCH, POINTS, RATE = 128, 256, 4, 64, 512, 4e-4
HELD = 8
# Points that must get nothing weigh this much in training; the local steps after it use the full weight.
LEAK_WEIGHT = 20.0


def room(rng: np.random.Generator):
    """A made-up scene."""
    size = rng.uniform([3, 2.2, 3], [6, 4.5, 6])
    house = _block((0, 0, 0), size)
    wall = rng.choice([0.02, 0.05, 0.1, 0.2])
    kind = rng.integers(0, 4)
    cut = size * rng.uniform(0.3, 0.7, 3)
    axes = {0: [], 1: [0], 2: [0, 2], 3: [1]}[int(kind)]
    spans = [
        [(0.0, cut[k] - wall / 2), (cut[k] + wall / 2, size[k])] if k in axes else [(0.0, size[k])] for k in range(3)
    ]
    for x in spans[0]:
        for y in spans[1]:
            for z in spans[2]:
                house.carve((x[0], y[0], z[0]), (x[1], y[1], z[1]), WHITE)
    for k in axes:
        low, high = np.zeros(3), np.zeros(3)
        low[k], high[k] = cut[k] - wall / 2, cut[k] + wall / 2
        for j in set(range(3)) - {k}:
            width = min(rng.uniform(0.6, 1.4), 0.8 * size[j])
            start = 0.0 if j == 1 and k != 1 else rng.uniform(0, size[j] - width)
            low[j], high[j] = start, start + (min(2.0, 0.8 * size[1]) if j == 1 and k != 1 else width)
        if rng.random() < 0.8:
            house.carve(low, high, WHITE)
    kit = _kit("made-up")
    for number in range(rng.integers(0, 5)):
        half = np.array([rng.uniform(0.05, 0.8), rng.uniform(0.4, size[1] / 2), rng.choice([0.015, 0.05, 0.2])])
        part, angle = box(-half, half), rng.uniform(0, np.pi)
        tilt = rng.uniform(-0.5, 0.5) if rng.random() < 0.5 else 0.0
        c, s, a, b = np.cos(angle), np.sin(angle), np.cos(tilt), np.sin(tilt)
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.array([[1, 0, 0], [0, a, -b], [0, b, a]])
        at = rng.uniform(0.2, 0.8, 3) * size
        part = replace(part, positions=part.positions @ turn.T + at, normals=part.normals @ turn.T)
        kit.add(f"part{number}", "white", part)
    return _finish(kit, house, (*(0.5 * size), 1.0))


def cubes(count: int, seed: int) -> list[dict]:
    """For each room: targets [n, Q], which points lie in air, and places at surfaces."""
    rng, out = np.random.default_rng(seed), []
    for number in range(count):
        try:
            made = bake_geometry(room(rng), float(rng.uniform(0.7, 1.3)), "relu-field", rng.random(3), fit=_nothing)
        except (ValueError, RuntimeError) as problem:
            print(f"room {number} left out: {problem}")
            continue
        level = made.levels[0]
        rows = np.flatnonzero(made.records[0].state == WEIGHTED)[:64]
        if len(rows):
            valid, near = cube_valid(level.support, level.nodes[rows]), close_points(level, rows)
            out.append({"target": level.target[rows, : level.points], "valid": valid, "close": near})
    return out


def _nothing(target, weight, layout, close):
    return np.zeros((len(target), FUNCTIONS["relu-field"].parameters), np.float32)


def components(target: np.ndarray, layout) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean, principal components and the share of variance that they keep, of hat · ρ."""
    rows = target.astype(np.float32) * layout.hat.astype(np.float32)
    mean = rows.mean(axis=0)
    values, vectors = np.linalg.eigh((rows - mean).T @ (rows - mean))
    kept = vectors[:, ::-1][:, :COMPONENTS]
    return mean, kept.astype(np.float32), float(values[::-1][:COMPONENTS].sum() / values.sum())


def train(function: str, x: np.ndarray, target, valid, layout, steps: int, seed: int) -> list[np.ndarray]:
    """Layers of the network for one weight function, by Adam through the decoder."""
    f, rng = FUNCTIONS[function], np.random.default_rng(seed)
    widths = [COMPONENTS, *[WIDTH] * (LAYERS - 1), f.parameters]
    layers = []
    for k, (a, b) in enumerate(pairwise(widths)):
        scale = (0.05 if k + 2 == len(widths) else 1.0) * np.sqrt(2 / a) * (1.0 if k == 0 else 0.5)
        layers += [rng.normal(0, scale, (a, b)).astype(np.float32), np.zeros(b, np.float32)]
    layers[0] /= np.maximum(x.std(axis=0), 1e-3)[:, None]
    layers[-1][:] = f.initial(1)[0] if function == "mlp" else 0.5
    mean, square = ([np.zeros_like(a) for a in layers] for _ in range(2))
    for step in range(steps):
        rows, points = rng.integers(0, len(x), BATCH), rng.choice(len(layout.u), POINTS, replace=False)
        params, kept = run(layers, x[rows])
        value, state = f.values(params, layout.u[points])
        goal, air = target[rows][:, points].astype(np.float32), valid[rows][:, points]
        weight = layout.hat[points].astype(np.float32) ** 2 * np.where(air, np.where(goal > 0, 1, LEAK_WEIGHT), 0.02)
        rho = trusted(value)
        steep = np.where((value < 0) | (value > 1), np.float32(0.05), np.float32(1))
        back = f.gradient(state, (weight * (rho - goal) * steep / POINTS).astype(np.float32))
        gradients = []
        for k in range(LAYERS - 1, -1, -1):
            before, slope = kept[k]
            dz = back if slope is None else back * slope
            gradients[:0] = [before.T @ dz / BATCH, dz.mean(axis=0)]
            through = dz @ layers[2 * k].T
            back = through if k in (0, LAYERS - 1) else back + through
        speed = RATE * 2.5 * 0.5 * (1 + np.cos(np.pi * step / steps))
        for layer, g, m, v in zip(layers, gradients, mean, square):
            m += 0.1 * (g - m)
            v += 0.01 * (g * g - v)
            right = np.sqrt(1 - 0.99 ** (step + 1)) / (1 - 0.9 ** (step + 1))
            layer -= (speed * right * m / (np.sqrt(v) + 1e-10)).astype(np.float32)
    return layers


def figures(held: list[dict], generator: Generator, layout) -> dict:
    """Errors on held-out rooms: network alone, with its local steps, and fitted from scratch."""
    out = {}
    target = np.concatenate([part["target"] for part in held]).astype(np.float32)[:192]
    valid = np.concatenate([part["valid"] for part in held])[:192]
    weight = point_weight(target, layout.hat, valid)
    for name in generator.networks:
        f = FUNCTIONS[name]
        tried = {"network": generator(name, target, layout)}
        clock = perf_counter()
        tried["refined"] = fit_with(name, generator)(target, weight, layout)
        seconds = perf_counter() - clock
        if name != "mlp":
            tried["direct"] = f.fit(target, weight, layout)
        for how, params in tried.items():
            rho = trusted(f.values(f.quantised(params), layout.u)[0])
            out[f"{name}, {how}"] = {
                "rmse": round(float(np.mean(error(target, rho, layout.hat, valid))), 5),
                "leak": round(leak(target, rho, layout.hat, valid), 5),
                "under": round(under(target, rho, layout.hat), 5),
            }
        out[f"{name}, ms per probe"] = round(1000 * seconds / len(target), 2)
    return out


def main() -> None:
    """Make rooms, train, write, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rooms", type=int, default=240)
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, default=FILE)
    arguments = parser.parse_args()
    clock, layout = perf_counter(), pattern()
    parts = cubes(arguments.rooms, arguments.seed)
    held, learned = parts[::HELD], [p for k, p in enumerate(parts) if k % HELD]
    target, valid = (np.concatenate([p[name] for p in learned]) for name in ("target", "valid"))
    print(f"{len(parts)} rooms, {len(target)} cubes, {perf_counter() - clock:.0f} s")
    mean, kept, share = components(target, layout)
    x = (target.astype(np.float32) * layout.hat.astype(np.float32) - mean) @ kept
    networks = {}
    for name in ("relu-field", "mlp"):
        networks[name] = train(name, x, target, valid, layout, arguments.steps, arguments.seed)
        print(f"{name} trained, {perf_counter() - clock:.0f} s")
    Generator(mean, kept, networks).save(arguments.output)
    found = figures(held, load(arguments.output), layout)
    found |= {"rooms": len(parts), "cubes": len(target), "held-out rooms": len(held), "variance kept": round(share, 4)}
    found |= {"seed": arguments.seed, "steps": arguments.steps, "bytes": arguments.output.stat().st_size}
    arguments.output.with_suffix(".json").write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
