"""Replay of camera rays: rays of earlier cameras are traced again in the current scene.

This keeps the cache trained in regions that have left the screen. The pool stores rays and no radiance, so that it
stays valid when lights or objects change.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import mi

# Rays in the pool, and rays that are kept of each earlier camera.
CAPACITY, PER_CAMERA = 4096, 512


class Replay:
    """Pool of rays; once it is full, new ones replace random old ones."""

    def __init__(self) -> None:
        """Make an empty pool."""
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
        """Return the state that the next frame depends on.

        Returns:
            Dictionary of JSON types, and arrays [CAPACITY, 3] of origins and directions with those of the last frame.
        """
        arrays = {"o": self._o, "d": self._d}
        if self._last is not None:
            arrays |= {"last_o": np.array(self._last[0]), "last_d": np.array(self._last[1])}
        return {"held": self.held, "pose": self._pose, "random": self._rng.bit_generator.state}, arrays

    def restore(self, state: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Restore the state of a checkpoint.

        Args:
            state: Dictionary from ``state``.
            arrays: Arrays from ``state``, [CAPACITY, 3] float32 each for "o" and "d".

        Raises:
            ValueError: The arrays are of another shape or type, or the number of rays is out of range.
        """
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
        """Announce the camera of the next frame; if it has moved, rays of the last frame are added to the pool.

        Args:
            pose: Text that identifies the camera's transform.
        """
        if pose != self._pose and self._last is not None:
            self._keep(*self._last)
        self._pose = pose

    def saw(self, origins: Any, directions: Any) -> None:
        """Store the rays of a frame.

        Args:
            origins: [P] origins on the device, metres.
            directions: [P] unit directions on the device.
        """
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
