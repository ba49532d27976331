"""Rays of earlier cameras: what went off screen is traced anew now and then, in the scene of today.

A pool of places, not of radiance: nothing in it goes stale when light or objects change.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import mi

# Rays that are kept, and how many of a camera that goes.
CAPACITY, PER_CAMERA = 4096, 512


class Replay:
    """A pool of rays; older ones give way at random."""

    def __init__(self) -> None:
        self.held = 0
        """Rays in the pool."""
        self._o, self._d = np.zeros((CAPACITY, 3), np.float32), np.zeros((CAPACITY, 3), np.float32)
        self._d[:, 2] = 1
        self._pose = ""
        self._last: Any = None
        self._rng = np.random.default_rng(0)
        self.pool = (mi.Point3f(self._o.T), mi.Vector3f(self._d.T))
        """Origins and directions on the device."""

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """What the next frame depends on: values of JSON types, and arrays."""
        arrays = {"o": self._o, "d": self._d}
        if self._last is not None:
            arrays |= {"last_o": np.array(self._last[0]), "last_d": np.array(self._last[1])}
        return {"held": self.held, "pose": self._pose, "random": self._rng.bit_generator.state}, arrays

    def restore(self, state: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Take over what ``state`` gave."""
        if any(arrays[name].shape != (CAPACITY, 3) or arrays[name].dtype != np.float32 for name in "od"):
            raise ValueError(f"the pool of rays is not {CAPACITY} x 3 numbers")
        self.held, self._pose = int(state["held"]), str(state["pose"])
        if not 0 <= self.held <= CAPACITY:
            raise ValueError(f"{self.held} rays in a pool of {CAPACITY}")
        self._rng.bit_generator.state = state["random"]
        self._o, self._d = arrays["o"], arrays["d"]
        if "last_o" in arrays:
            self._last = (arrays["last_o"], arrays["last_d"])
        self._upload()

    def look(self, pose: str) -> None:
        """Before a frame: where the camera is a new one, keep rays of the one before."""
        if pose != self._pose and self._last is not None:
            self._keep(*self._last)
        self._pose = pose

    def saw(self, origins: Any, directions: Any) -> None:
        """After a frame: its rays [P], on the device."""
        self._last = (origins, directions)

    def _keep(self, origins: Any, directions: Any) -> None:
        o, d = np.array(origins).T, np.array(directions).T
        chosen = self._rng.choice(len(o), min(PER_CAMERA, len(o)), replace=False)
        if self.held + len(chosen) <= CAPACITY:
            rows = np.arange(self.held, self.held + len(chosen))
        else:
            rows = self._rng.choice(CAPACITY, len(chosen), replace=False)
        self._o[rows], self._d[rows] = o[chosen], d[chosen]
        self.held = min(CAPACITY, max(self.held, int(rows.max()) + 1))
        self._upload()

    def _upload(self) -> None:
        self.pool = (mi.Point3f(self._o.T.copy()), mi.Vector3f(self._d.T.copy()))
