"""A camera that turns about what it looks at."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.scenes.scene import Camera

# Limits of accumulated movements: exponent of e of one step; distance of the camera over the scene's extent (and its
# inverse).
CLOSER, FARTHEST = 5.0, 1e3
# Cosine between axis and view beyond which the camera is not tilted further.
STEEPEST = 0.985
# Smallest distance between camera and target over the scene's extent.
NEAREST_TARGET = 0.2


def outside(low: np.ndarray, high: np.ndarray) -> Camera:
    """Place a camera outside of a box, looking at its centre.

    Args:
        low: [3] smallest corner, metres.
        high: [3] largest corner, metres.

    Returns:
        The camera.
    """
    center, extent = (low + high) / 2, float((high - low).max())
    return Camera(tuple(center + np.array([0.6, 0.4, 1.2]) * extent), tuple(center))


class OrbitCamera:
    """Position and target of a perspective camera."""

    def __init__(self, camera: Camera, low: np.ndarray, high: np.ndarray) -> None:
        """Start with a camera of a scene.

        The target is moved along the view to the depth of the scene's centre, so that the camera does not turn about a
        point right in front of it.

        Args:
            camera: First view.
            low: [3] smallest corner of the scene's box, metres.
            high: [3] largest corner, metres.
        """
        self.position, self.up, self.fov = np.array(camera.position, float), np.array(camera.up, float), camera.fov_y
        """Position in metres, direction up, vertical field of view in degrees."""
        self._extent = float((high - low).max())
        forward = np.array(camera.target, float) - self.position
        forward /= np.linalg.norm(forward)
        depth = float(((low + high) / 2 - self.position) @ forward)
        self.target = self.position + forward * max(depth, NEAREST_TARGET * self._extent)

    def pose(self) -> Any:
        """Return the transform from camera to world space.

        Returns:
            Mitsuba scalar transform.
        """
        return mi.ScalarTransform4f().look_at(
            origin=self.position.tolist(), target=self.target.tolist(), up=self.up.tolist()
        )

    def apply(self, sensor: Any) -> None:
        """Set the pose of a sensor.

        Args:
            sensor: Mitsuba sensor.
        """
        parameters = mi.traverse(sensor)
        parameters["to_world"] = mi.Transform4f(self.pose().matrix)
        parameters.update()

    def orbit(self, right: float, up: float, closer: float) -> None:
        """Rotate the camera about the target and move it closer by a factor e^``closer``.

        Args:
            right: Angle about the vertical axis, radians.
            up: Elevation angle, radians; not applied near the poles.
            closer: Exponent of the approach, clamped to ±``CLOSER``.
        """
        offset = self.position - self.target
        axis = self.up / np.linalg.norm(self.up)
        offset = _turned(offset, axis, -right)
        side = np.cross(axis, offset)
        side /= max(np.linalg.norm(side), 1e-9)
        tilted = _turned(offset, side, -up)
        # A camera that starts steeper may still be tilted towards the horizon.
        if abs(tilted @ axis) < max(STEEPEST * np.linalg.norm(tilted), abs(offset @ axis)):
            offset = tilted
        distance = np.linalg.norm(offset) * np.exp(-np.clip(closer, -CLOSER, CLOSER))
        distance = np.clip(distance, self._extent / FARTHEST, self._extent * FARTHEST)
        self.position = self.target + offset * (distance / np.linalg.norm(offset))


def _turned(v: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' rotation."""
    c, s = np.cos(angle), np.sin(angle)
    return v * c + np.cross(axis, v) * s + axis * (axis @ v) * (1 - c)
