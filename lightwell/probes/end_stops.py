"""Factors of bases that keep dark what is dark where something stands at an end stop.

A spline through the states of a light and of what moves has no step: at a shut door it adds the light of open doors.
Its factors c are replaced by those next to them under which the probes behind the door stay dark,

    c' = argmin |B c' - B c|² + λ² |D c'|²  =  c + M c,

with B the light of the bases at all probes that count, and D that at the probes which are dark. M is a matrix for each
end stop; from the stop to the next pose that was traced it fades out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lightwell.probes.spline import EndStop, SplineMix

# A probe is dark at an end stop where the brightest state there has less than this share of the light that the
# brightest of the same lights gives it at the other end stop, and that light is more than this share of the mean.
DARK, LIT = 0.01, 1e-3
# λ: light at dark probes counts so many times as much as elsewhere. courtyard-day, 24 states, each of five shut ones
# left out: behind the door 46 % of the open light without, 6.1, 2.9, 2.0, 1.3 % with 100, 300, 500, 1000; error
# elsewhere 64 % without, 49, 42, 42, 46 %.
STRENGTH = 500.0


def dark_at_stops(
    mix: SplineMix,
    light: np.ndarray,
    pose: np.ndarray,
    states: np.ndarray,
    bases: np.ndarray,
    nodes: Sequence[Sequence[float]],
) -> SplineMix:
    """Add end stops to a spline, as far as anything is dark at them.

    Args:
        mix: Spline through the factors of S states.
        light: [S, 3] positions or directions of the light in the states.
        pose: [S, M] sliders of what moves.
        states: [S, P, 9, 3] light of the states at the probes that count.
        bases: [P, 9, 3, K] bases at these.
        nodes: For each of the M movers, the sliders that were traced, increasing from 0 to 1.

    Returns:
        The spline with its end stops.
    """
    flat = bases.reshape(len(bases), -1, bases.shape[-1]).astype(np.float64)
    size = np.linalg.norm(states.reshape(*states.shape[:2], -1), axis=2)
    found = []
    for mover, sliders in enumerate(nodes):
        for at, next_one in ((0.0, sliders[1]), (1.0, sliders[-2])):
            here = np.flatnonzero(pose[:, mover] == at)
            if not len(here):
                continue
            other = pose[here].copy()
            other[:, mover] = 1 - at
            there = np.einsum("pck,sk->spc", flat, mix.factors(light[here], other).astype(np.float64))
            lit = np.linalg.norm(there, axis=2).max(axis=0)
            dark = (size[here].max(axis=0) < DARK * lit) & (lit > LIT * lit.mean())
            if dark.any():
                found.append(EndStop(mover, at, abs(next_one - at), darkened(flat, dark)))
    return replace(mix, stops=tuple(found))


def darkened(bases: np.ndarray, dark: np.ndarray) -> np.ndarray:
    """Compute M of the module.

    Args:
        bases: [P, C, K] light of the bases.
        dark: [P] bool, the probes that stay dark.

    Returns:
        [K, K] what is added to factors, as a function of them.
    """
    width = bases.shape[-1]
    rows, dim = bases.reshape(-1, width), bases[dark].reshape(-1, width)
    # In an orthonormal frame of the light; directions that no light has are left as they are.
    values, vectors = np.linalg.eigh(rows.T @ rows)
    kept = values > 1e-12 * values.max()
    to = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
    back = vectors[:, kept] / np.sqrt(values[kept])
    gram = back.T @ (dim.T @ dim) @ back
    change = np.linalg.inv(np.eye(len(gram)) + STRENGTH**2 * gram) - np.eye(len(gram))
    return back @ change @ to
