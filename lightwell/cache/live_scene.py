"""Mitsuba scene of the live page, whose camera, lights, objects and materials change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.cache.orbit_camera import OrbitCamera, outside
from lightwell.core.scene_edits import Paint, SceneEdits
from lightwell.scenes.edits import bsdfs_of, can_paint, content_of, dim, paint_bsdf, translate
from lightwell.scenes.scene import Camera, Scene

# Limits of the accumulated factor of a light.
GAINS = (1e-6, 1e6)
# Index of the lamp that is added to a scene.
LAMP = -1


@dataclass(frozen=True)
class Lamp:
    """Point light that is added to a scene."""

    place: np.ndarray
    """[3] position, metres."""
    intensity: float
    """Radiant intensity, relative linear units."""


class LiveScene:
    """Mitsuba scene with one sensor, and its movable camera, lights, objects and materials."""

    def __init__(self, loaded: Scene, size: int, camera: Camera | None = None, lamp: Lamp | None = None) -> None:
        """Build the Mitsuba scene of a session.

        Args:
            loaded: The scene; its shapes and materials are shared, and edited with this one.
            size: Edge of the sensor's square film, pixels.
            camera: Initial view; None: the scene's first camera, or else one outside of its core.
            lamp: Point light to add; None: one is added only if nothing in the scene shines.
        """
        self.name = loaded.name
        self.loaded = loaded
        low, high = loaded.core
        self.extent = loaded.core_extent
        """Length by which objects are moved, metres."""
        if lamp is None and not loaded.has_static_light:
            lamp = Lamp((low + high) / 2 + np.array([0, 0.3 * (high - low)[1], 0]), self.extent**2)
        self.lamp = lamp
        """Point light that was added, as it is now; None: there is none."""
        self.camera = OrbitCamera(camera or (loaded.cameras[0] if loaded.cameras else outside(low, high)), low, high)
        sensor = {
            "type": "perspective", "fov": self.camera.fov, "fov_axis": "y", "to_world": self.camera.pose(),
            "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
        }  # fmt: skip
        content = content_of(loaded)
        if lamp is not None:
            power = {"type": "rgb", "value": lamp.intensity}
            content["lamp"] = {"type": "point", "position": np.asarray(lamp.place).tolist(), "intensity": power}
        self.scene = mi.load_dict(content | {"sensor": sensor})
        self.sensor = self.scene.sensors()[0]
        self.parameters = mi.traverse(self.scene)
        names = [m.name or f"surface {k}" for k, m in enumerate(loaded.meshes)]
        self.things: list[dict[str, Any]] = [
            {"index": k, "name": names[k] if k < len(names) else f"surface {k}", "light": s.emitter() is not None}
            for k, s in enumerate(self.scene.shapes())
            if f"shape{k}.vertex_positions" in self.parameters
        ]
        """Lights and objects that can be moved; index ``LAMP`` is the added lamp."""
        if lamp is not None:
            self.things.insert(0, {"index": LAMP, "name": "lamp", "light": True})
        self.materials: list[dict[str, Any]] = [
            {"index": k, "name": material.name or f"material {k}", "color": list(material.base_color[:3]),
             "roughness": material.roughness}
            for k, material in enumerate(loaded.materials) if any(can_paint(bsdf) for bsdf in bsdfs_of(loaded, k))
        ]  # fmt: skip
        """Materials that can be painted."""
        self._gains: dict[int, float] = {}
        self._moved: dict[int, np.ndarray] = {}
        self._painted: dict[int, Paint] = {}
        self._unpainted: dict[int, dict[str, Any]] = {}

    @property
    def edits(self) -> SceneEdits:
        """Return what differs from the file; the added lamp is not among it, because no bake has it."""
        moved = {k: (float(by[0]), float(by[1]), float(by[2])) for k, by in self._moved.items()}
        dimmed = {k: gain for k, gain in self._gains.items() if k != LAMP}
        return SceneEdits(moved, dimmed, dict(self._painted))

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
            index: Index of the object; ``LAMP``: the added lamp.
            by: [3] vector in units of the scene's extent.
        """
        step = np.asarray(by, float) * self.extent
        if index != LAMP:
            self._moved[index] = self._moved.get(index, np.zeros(3)) + step
            return translate(self.parameters, f"shape{index}.", step)
        assert self.lamp is not None
        self.lamp = replace(self.lamp, place=np.asarray(self.lamp.place) + step)
        self.parameters["lamp.position"] = mi.Point3f(*(float(x) for x in self.lamp.place))
        self.parameters.update()

    def brighten(self, index: int, factor: float) -> None:
        """Multiply the radiance of a light; the accumulated factor stays within ``GAINS``.

        Args:
            index: Index of an emitting object; ``LAMP``: the added lamp.
            factor: Factor, > 0.
        """
        before = self._gains.get(index, 1.0)
        self._gains[index] = float(np.clip(before * factor, *GAINS))
        factor = self._gains[index] / before
        if index == LAMP and self.lamp is not None:
            self.lamp = replace(self.lamp, intensity=self.lamp.intensity * factor)
        dim(self.parameters, "lamp.intensity" if index == LAMP else f"shape{index}.emitter.radiance", factor)

    def paint(self, material: int, color: tuple[float, float, float] | None, roughness: float | None) -> None:
        """Give a material another colour or roughness.

        Args:
            material: Index of the material.
            color: Linear colour in [0, 1], see ``Paint``; None: as it was.
            roughness: Roughness; None: as it was.
        """
        before = self._painted.get(material, Paint())
        paint = Paint(
            before.color if color is None else color, before.roughness if roughness is None else roughness
        )  # fmt: skip
        self._painted[material] = paint
        for number, bsdf in enumerate(bsdfs_of(self.loaded, material)):
            kept = self._unpainted.setdefault(material, {}).setdefault(str(number), {})
            paint_bsdf(mi.traverse(bsdf), paint, kept)
        for entry in self.materials:
            if entry["index"] == material:
                entry["color"] = list(paint.color or entry["color"])
                entry["roughness"] = entry["roughness"] if paint.roughness is None else paint.roughness
