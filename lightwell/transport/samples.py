"""Records that the path tracer hands to the fields. N samples; NumPy float32 unless said otherwise."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np


def columns_of(record: Any) -> dict[str, np.ndarray]:
    """Return the columns of a record of rows that are there.

    Args:
        record: ``SurfacePoints`` or ``Query``.

    Returns:
        Arrays [N, ...] by name; those that are None are left out.
    """
    return {f.name: value for f in fields(record) if (value := getattr(record, f.name)) is not None}


def rows_of(values: np.ndarray, rows: Any) -> np.ndarray:
    """Take rows of a column.

    Args:
        values: [N, ...] column.
        rows: Indices, a mask, or a slice.

    Returns:
        The rows.
    """
    # A third of the time of an index in brackets.
    indices = isinstance(rows, np.ndarray) and rows.ndim == 1 and rows.dtype.kind in "iu"
    return np.take(values, rows, axis=0) if indices else values[rows]


@dataclass(frozen=True)
class SurfacePoints:
    """N points on the surfaces of a scene, identified by triangle so that they can be rebuilt exactly."""

    shape: np.ndarray
    """[N] uint32, index into ``Scene.meshes``."""
    triangle: np.ndarray
    """[N] uint32, index into that mesh's triangles."""
    barycentric: np.ndarray
    """[N, 2] weights of the triangle's second and third vertex."""
    view: np.ndarray
    """[N, 3] unit direction from the point to the camera; its side of the surface is the side that is seen."""
    pose: np.ndarray | None = None
    """[N, M] sliders of the scene's movers at each point, 0 to 1; None: the scene is as its records say."""

    def __len__(self) -> int:
        return len(self.shape)

    def __getitem__(self, rows) -> SurfacePoints:
        return type(self)(**{name: rows_of(values, rows) for name, values in columns_of(self).items()})


@dataclass(frozen=True)
class Query:
    """Inputs of a field at N surface points: the named inputs of a shading graph (see format/FORMAT.md).

    The arrays may be NumPy [N, C] or, inside Dr.Jit code, tensors [C, N].
    """

    position: np.ndarray
    """[N, 3] world, metres."""
    normal: np.ndarray
    """[N, 3] unit interpolated vertex normal on the viewer's side (no normal map)."""
    view: np.ndarray
    """[N, 3] unit, from the point to the camera."""
    light: np.ndarray
    """[N, 3] position of the declared point light, or unit direction to the declared sun."""
    reflectance: np.ndarray
    """[N, 3] base colour + 0.04 (1 - metallic), at least 1e-3: what the learned value is multiplied by."""
    roughness: np.ndarray
    """[N, 1] glTF roughness in [0, 1]."""
    metallic: np.ndarray
    """[N, 1] glTF metalness in [0, 1]."""
    shading_normal: np.ndarray = None  # type: ignore[assignment]
    """[N, 3] ``normal`` bent by the normal maps of the materials; left out: none has one."""
    pose: np.ndarray = None  # type: ignore[assignment]
    """[N, M] sliders of the scene's movers, 0 to 1; this and the next two are None where nothing moves."""
    rest_position: np.ndarray = None  # type: ignore[assignment]
    """[N, 3] metres: where the surface is when the scene is at rest; ``position`` on what does not move."""
    rest_normal: np.ndarray = None  # type: ignore[assignment]
    """[N, 3] ``normal`` at rest."""

    def __post_init__(self) -> None:
        if self.shading_normal is None:
            object.__setattr__(self, "shading_normal", self.normal)

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, rows) -> Query:
        return type(self)(**{name: rows_of(values, rows) for name, values in columns_of(self).items()})


@dataclass(frozen=True)
class Samples:
    """N training or test samples of indirect radiance for a white light of 1 cd (1 lx for a sun)."""

    query: Query
    half_a: np.ndarray
    """[N, 3] mean over the first half of the paths: indirect radiance towards ``view``, reflectance included."""
    half_b: np.ndarray
    """[N, 3] mean over the second, independent half."""
    weight: np.ndarray
    """[N] 1 / (density relative to area-uniform sampling), so that a weighted mean estimates the area-uniform mean."""
    shape: np.ndarray
    """[N] uint32, index into ``Scene.meshes``."""

    @property
    def radiance(self) -> np.ndarray:
        """[N, 3] mean of both halves."""
        return 0.5 * (self.half_a + self.half_b)

    def limited(self, most: float) -> Samples:
        """Limit the radiance of both halves.

        Args:
            most: Largest radiance, > 0.

        Returns:
            The samples.
        """
        return replace(self, half_a=np.minimum(self.half_a, most), half_b=np.minimum(self.half_b, most))

    def __len__(self) -> int:
        return len(self.shape)

    def __getitem__(self, rows) -> Samples:
        columns = {f.name: rows_of(getattr(self, f.name), rows) for f in fields(self) if f.name != "query"}
        return type(self)(query=self.query[rows], **columns)

    def in_runs(self, order: np.ndarray, length: int) -> Samples:
        """Take runs of neighbouring rows, in another order; several times as fast as row by row.

        Args:
            order: Numbers of runs.
            length: Rows of a run; it divides N.

        Returns:
            The rows of these runs.
        """
        query = Query(**{name: _in_runs(values, order, length) for name, values in columns_of(self.query).items()})
        columns = {f.name: _in_runs(getattr(self, f.name), order, length) for f in fields(self) if f.name != "query"}
        return type(self)(query=query, **columns)


def _in_runs(values: np.ndarray, order: np.ndarray, length: int) -> np.ndarray:
    """Rows of runs of an array [N, ...]."""
    runs = values.reshape(-1, length, *values.shape[1:])
    return np.take(runs, order, axis=0).reshape(-1, *values.shape[1:])
