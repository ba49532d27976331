"""Mitsuba scene of the live page, whose camera, lights and objects move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.cache.orbit_camera import OrbitCamera, outside
from lightwell.cache.scene_region import bounds_of
from lightwell.scenes.scene import Camera, Scene

# Limits of the accumulated factor of a light.
GAINS = (1e-6, 1e6)


@dataclass(frozen=True)
class Lamp:
    """Point light that is added to a scene."""

    place: np.ndarray
    """[3] position, metres."""
    intensity: float
    """Radiant intensity, relative linear units."""


class LiveScene:
    """Mitsuba scene with one sensor, and its movable camera, lights and objects."""

    def __init__(self, loaded: Scene, size: int, camera: Camera | None = None, lamp: Lamp | None = None) -> None:
        """Build the Mitsuba scene of a session.

        Args:
            loaded: The scene.
            size: Edge of the sensor's square film, pixels.
            camera: Initial view; None: the scene's first camera, or else one outside of its bounds.
            lamp: Point light to add; None: one is added only if the scene has no emitter.
        """
        self.name = loaded.name
        low, high = bounds_of(loaded.mi)
        self.extent = float((high - low).max())
        self.gains: dict[int, float] = {}
        """Index of a light to the factor of its radiance so far."""
        if lamp is None and not loaded.mi.emitters():
            lamp = Lamp((low + high) / 2 + np.array([0, 0.3 * (high - low)[1], 0]), self.extent**2)
        self.lamp = lamp
        """Point light that was added, where it stood at first; None: there is none."""
        self.camera = OrbitCamera(camera or (loaded.cameras[0] if loaded.cameras else outside(low, high)), low, high)
        sensor = {
            "type": "perspective", "fov": self.camera.fov, "fov_axis": "y", "to_world": self.camera.pose(),
            "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
        }  # fmt: skip
        self.scene = mi.load_dict(_content(loaded, lamp) | {"sensor": sensor})
        self.sensor = self.scene.sensors()[0]
        self.parameters = mi.traverse(self.scene)
        names = [m.name or f"surface {k}" for k, m in enumerate(loaded.meshes)]
        self.things: list[dict[str, Any]] = [
            {"index": k, "name": names[k] if k < len(names) else f"surface {k}", "light": s.emitter() is not None}
            for k, s in enumerate(self.scene.shapes())
            if f"shape{k}.vertex_positions" in self.parameters
        ]
        """Lights and objects that can be moved; index -1 is the added lamp."""
        if lamp is not None:
            self.things.insert(0, {"index": -1, "name": "lamp", "light": True})

    def orbit(self, right: float, up: float, closer: float) -> None:
        """Move the camera of the sensor, see ``OrbitCamera.orbit``.

        Args:
            right: Angle about the vertical axis, radians.
            up: Elevation angle, radians.
            closer: Exponent of e of the approach.
        """
        self.camera.orbit(right, up, closer)
        self.camera.apply(self.sensor)

    def move(self, index: int, by: np.ndarray) -> None:
        """Translate an object or the added lamp.

        Args:
            index: Index of the object; -1: the added lamp.
            by: [3] vector in units of the scene's extent.
        """
        step = np.asarray(by, float) * self.extent
        if index < 0:
            key = "lamp.position"
            self.parameters[key] = mi.Point3f(self.parameters[key]) + mi.Vector3f(*step.tolist())
        else:
            key = f"shape{index}.vertex_positions"
            places = np.array(self.parameters[key]).reshape(-1, 3) + step
            self.parameters[key] = mi.Float(places.astype(np.float32).ravel())
        self.parameters.update()

    def brighten(self, index: int, factor: float) -> None:
        """Multiply the radiance of a light; the accumulated factor stays within ``GAINS``.

        Args:
            index: Index of an emitting object; -1: the added lamp.
            factor: Factor, > 0.
        """
        before = self.gains.get(index, 1.0)
        self.gains[index] = float(np.clip(before * factor, *GAINS))
        factor = self.gains[index] / before
        start = "lamp.intensity" if index < 0 else f"shape{index}.emitter.radiance"
        for key in list(self.parameters.keys()):
            if key.startswith(start) and key.endswith((".value", ".data")):
                self.parameters[key] = self.parameters[key] * factor
        self.parameters.update()


def _content(loaded: Scene, lamp: Lamp | None) -> dict[str, Any]:
    """Shapes, environment and lamp as Mitsuba's dictionary."""
    content: dict[str, Any] = {"type": "scene"}
    for k, shape in enumerate(loaded.mi.shapes()):
        content[f"shape{k}"] = shape
    if (environment := loaded.mi.environment()) is not None:
        content["environment"] = environment
    if lamp is not None:
        power = {"type": "rgb", "value": lamp.intensity}
        content["lamp"] = {"type": "point", "position": np.asarray(lamp.place).tolist(), "intensity": power}
    return content
