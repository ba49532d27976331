"""A baseline without leaks and without diffusion around corners: trilinear weights times traced visibility."""

from __future__ import annotations

import numpy as np

from lightwell.probes import rays, sh
from lightwell.probes.support import Support
from lightwell.probes.volume import OFFSET
from lightwell.scenes.scene import Scene


def query(
    scene: Scene, support: Support, light: np.ndarray, x: np.ndarray, n: np.ndarray, offset: float = OFFSET
) -> np.ndarray:
    """Compute the irradiance at some points, with one visibility ray per point and probe.

    Args:
        scene: The scene.
        support: Geometry of the lattice with P nodes.
        light: [P, 9, 3] irradiance harmonics at the probes.
        x: [N, 3] points, metres.
        n: [N, 3] unit normals.
        offset: Offset of the points along their normals, units of the spacing.

    Returns:
        [N, 3] irradiance; 0 where no probe is visible.
    """
    y = x + offset * support.lattice.spacing * n
    node, hat, _ = support.lattice.corners(y)
    seen = support.stands[node] & (hat > 0)
    row, corner = np.nonzero(seen)
    seen[row, corner] = rays.free(scene, support.origin[node[row, corner]], y[row])
    w = hat * seen
    w /= np.maximum(w.sum(axis=1, keepdims=True), 1e-12)
    return np.maximum(sh.evaluate(np.einsum("nk,nkbc->nbc", w, light[node]), n), 0)
