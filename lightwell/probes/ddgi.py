"""The baseline with distance moments: probes weighted by Chebyshev's inequality on mean and mean squared distance.

An implementation of our own after the papers: Majercik, Guertin, Nowrouzezahrai and McGuire, Dynamic Diffuse
Global Illumination with Ray-Traced Irradiance Fields, JCGT 8(2), 2019, and Scaling Probe-Based Real-Time
Dynamic Global Illumination for Production, JCGT 10(2), 2021. Distances are stored in octahedral maps of 16²
texels; irradiance is stored as in ``ProbeVolume`` (L2 harmonics), so that only the weights are compared.
Notation: P nodes, N points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes import rays, sh
from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.support import Support
from lightwell.scenes.scene import Scene

SIDE = 16
# Rays of a probe; exponent of the cosine lobe of a texel; distances are clamped to this many spacings.
RAYS, SHARPNESS, FARTHEST = 1024, 50.0, 1.5 * np.sqrt(3)
# Constants of the papers.
WRAP, LEAST, CRUSH, FLOOR = 0.2, 0.05, 0.2, 1e-3
# Bytes: 8² irradiance RGB10A2, 16² RG16F, data.
BYTES = 8 * 8 * 4 + SIDE * SIDE * 4 + 16


@dataclass(frozen=True)
class Moments:
    """The baked baseline."""

    lattice: ProbeLattice
    """Lattice of the probes."""
    origin: np.ndarray
    """[P, 3] positions of the probes after relocation, metres."""
    alive: np.ndarray
    """[P] bool: probes that lie in air."""
    maps: np.ndarray
    """[P, 16, 16, 2] float32 mean and mean squared distance, metres."""
    light: np.ndarray
    """[P, 9, 3] irradiance harmonics."""
    bias: float = 0.2
    """Offset of queries along the normal, units of the spacing."""


def bake_moments(scene: Scene, support: Support, light: np.ndarray, bias: float = 0.2) -> Moments:
    """Trace the distances of the probes that lie in air; other probes get no light.

    Args:
        scene: The scene.
        support: Geometry of the lattice.
        light: [P, 9, 3] irradiance harmonics at the probes.
        bias: Offset of queries along the normal, units of the spacing.

    Returns:
        The baseline.
    """
    stands = support.stands
    nodes = np.flatnonzero(stands)
    compass = sh.directions(RAYS)
    far = FARTHEST * support.lattice.spacing
    found = rays.distances(scene, support.origin[nodes], compass)
    # Back faces count at a fifth of their distance, as in the papers' code.
    found = np.minimum(np.where(found < 0, -0.2 * found, found), far)
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    texel = octahedral((np.stack([x, y], axis=-1).reshape(-1, 2) + 0.5) / SIDE * 2 - 1)
    lobe = np.maximum(texel @ compass.T, 0) ** SHARPNESS
    lobe /= lobe.sum(axis=1, keepdims=True)
    maps = np.full((len(support.lattice), SIDE, SIDE, 2), far, np.float32)
    maps[..., 1] = far**2
    mean, square = found @ lobe.T, found**2 @ lobe.T
    maps[nodes] = np.stack([mean, square], axis=-1).reshape(-1, SIDE, SIDE, 2)
    return Moments(support.lattice, support.origin, stands, maps, light * stands[:, None, None], bias)


def octahedral(p: np.ndarray) -> np.ndarray:
    """Map points of the octahedral square to directions.

    Args:
        p: [N, 2] in [-1, 1]².

    Returns:
        [N, 3] unit directions.
    """
    z = 1 - np.abs(p).sum(axis=1)
    fold = np.maximum(-z, 0)[:, None]
    xy = p - np.where(p >= 0, fold, -fold)
    d = np.concatenate([xy, z[:, None]], axis=1)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def to_octahedral(d: np.ndarray) -> np.ndarray:
    """Map directions to points of the octahedral square.

    Args:
        d: [N, 3] directions of any length above 0.

    Returns:
        [N, 2] in [-1, 1]².
    """
    p = d / np.maximum(np.abs(d).sum(axis=-1, keepdims=True), 1e-30)
    folded = (1 - np.abs(p[..., 1::-1])) * np.where(p[..., :2] >= 0, 1, -1)
    return np.where(p[..., 2:3] < 0, folded, p[..., :2])


def _fetch(maps: np.ndarray, node: np.ndarray, d: np.ndarray) -> np.ndarray:
    """[N, 2] bilinear moments of nodes [N] in directions [N, 3]; edges of the map wrap as on an octahedron."""
    at = (to_octahedral(d) + 1) * 0.5 * SIDE - 0.5
    low = np.floor(at).astype(np.int64)
    f = at - low
    out = np.zeros((len(node), 2))
    for k in range(4):
        bit = np.array([k & 1, k >> 1])
        texel = low + bit
        # Past an edge, the other coordinate is mirrored.
        for axis in (0, 1):
            over = (texel[:, axis] < 0) | (texel[:, axis] >= SIDE)
            texel[over, 1 - axis] = SIDE - 1 - texel[over, 1 - axis]
            texel[:, axis] = np.clip(texel[:, axis], 0, SIDE - 1)
        texel = np.clip(texel, 0, SIDE - 1)
        out += np.where(bit, f, 1 - f).prod(axis=1)[:, None] * maps[node, texel[:, 1], texel[:, 0]]
    return out


def shares(moments: Moments, x: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the normalised weights of the eight probes around each point.

    Args:
        moments: The baseline.
        x: [N, 3] float64 points, metres.
        n: [N, 3] float64 unit normals.

    Returns:
        [N, 8] indices of nodes, and [N, 8] weights that sum to 1 (0 where no probe is alive).
    """
    lattice = moments.lattice
    y = x + moments.bias * lattice.spacing * n
    node, _, u = lattice.corners(y)
    weight = np.empty(node.shape)
    for k in range(8):
        p = node[:, k]
        to_probe = moments.origin[p] - y
        r = np.linalg.norm(to_probe, axis=1)
        facing = ((moments.origin[p] - x) * n).sum(axis=1) / np.maximum(
            np.linalg.norm(moments.origin[p] - x, axis=1), 1e-9
        )
        wrap = ((facing + 1) / 2) ** 2 + WRAP
        mu, square = _fetch(moments.maps, p, -to_probe / np.maximum(r, 1e-9)[:, None]).T
        variance = np.abs(mu**2 - square)
        chebyshev = variance / np.maximum(variance + (r - mu) ** 2, 1e-12)
        w = wrap * np.where(r > mu, np.maximum(chebyshev**3, LEAST), 1)
        w = np.maximum(w, 1e-6)
        w = np.where(w < CRUSH, w**3 / CRUSH**2, w)
        weight[:, k] = w * np.maximum(1 - np.abs(u[:, k]), FLOOR).prod(axis=1) * moments.alive[p]
    return node, weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)


def query(moments: Moments, x: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Compute the irradiance at some points.

    Args:
        moments: The baseline.
        x: [N, 3] points, metres.
        n: [N, 3] unit normals.

    Returns:
        [N, 3] irradiance, ≥ 0.
    """
    node, share = shares(moments, np.asarray(x, np.float64), np.asarray(n, np.float64))
    return np.maximum(sh.evaluate(np.einsum("nk,nkbc->nbc", share, moments.light[node]), n), 0)
