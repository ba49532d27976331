"""What shards whose points lie where people look share: the points, and the columns that say where they are."""

from __future__ import annotations

from dataclasses import asdict
from functools import cached_property

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.point_rejection import Rejection
from lightwell.transport.radiance import PathReport
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.seen import draw_seen
from lightwell.transport.shards import ShardSettings

# Added to the index of an adaptive shard, so that it shares no random number with the others.
ADAPTIVE_STREAM = 1 << 20
# Random streams of a kind of shards: its points, and what it traces before the first shard.
STREAMS = 4


class SeenShards:
    """Base of shards that choose from one set of points; the points are drawn when the first shard is made."""

    _stream: int
    """Sets the random numbers of a kind of shards apart."""

    def __init__(self, scene: Scene, variable: Variable, settings: ShardSettings, count: int) -> None:
        """Prepare to make shards; nothing is traced yet.

        Args:
            scene: The scene.
            variable: The declared light; people look where it may be.
            settings: Sizes and seed.
            count: Points that the shards choose from, ≥ 1.
        """
        self._scene, self._variable, self._settings, self._count = scene, variable, settings, count

    @cached_property
    def _seeds(self) -> np.ndarray:
        return np.random.SeedSequence([self._settings.seed, self._stream]).generate_state(STREAMS)

    @cached_property
    def points(self) -> SurfacePoints:
        """Draw the points that all shards share.

        Returns:
            The points.
        """
        floor = max(self._count * self._settings.floor // self._settings.size, 1)
        return draw_seen(self._scene, self._variable, self._count, int(self._seeds[0]), floor=floor).points


def place_columns(points: SurfacePoints, weight: np.ndarray, flat: np.ndarray) -> dict[str, np.ndarray]:
    """Collect the columns of a shard that say where its rows are.

    Args:
        points: N points.
        weight: [N] weights of the points.
        flat: [N, 3] geometric normals.

    Returns:
        Columns by name, [N, ...] each.
    """
    columns = {"weight": weight, "shape": points.shape, "triangle": points.triangle}
    return columns | {"barycentric": points.barycentric, "flat": flat}


def path_counts(paths: int) -> dict[str, dict]:
    """Write the counts of a shard whose points were all valid.

    Args:
        paths: Light paths that were traced, ≥ 0.

    Returns:
        Counts of paths and of dropped points, as those of ``make_shard``.
    """
    return {"paths": asdict(PathReport(paths=paths)), "rejection": asdict(Rejection())}
