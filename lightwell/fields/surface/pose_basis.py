"""Nodes of the functions of a pose that weight the layers of lamps; see ``lightwell.graph.pose_basis``."""

from __future__ import annotations

import numpy as np

from lightwell.graph.pose_basis import PoseBasis
from lightwell.scenes.movers import pose_nodes

# Bases, at most. A layer of a lamp in each of them: of 48 features 4.6 kB, of 64 6.1 kB.
MOST_BASES = 16
# Traced poses for each base of several movers, at least: a base that no pose is near would not be learned.
POSES_PER_BASE = 2


def pose_basis(poses: np.ndarray) -> PoseBasis:
    """Choose the nodes for the poses that are traced: one mover has a node at each of them, where they are few.

    Args:
        poses: [K, M] sliders, each pose once or more often.

    Returns:
        The functions.
    """
    known = np.unique(np.asarray(poses, np.float64), axis=0)
    count, movers = known.shape
    if movers == 1 and 2 <= count <= MOST_BASES and known[0, 0] == 0 and known[-1, 0] == 1:
        return PoseBasis((tuple(known[:, 0].tolist()),))
    most, each = min(MOST_BASES, count if movers == 1 else count // POSES_PER_BASE), 2
    while (each + 1) ** movers <= most:
        each += 1
    return PoseBasis((tuple(pose_nodes(each)[:, 0].tolist()),) * movers)
