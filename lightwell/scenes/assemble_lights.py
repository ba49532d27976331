"""Lights of the records as Mitsuba emitters."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.assemble_textures import bitmap, linear_pixels
from lightwell.scenes.scene import Light, Material
from lightwell.scenes.vectors import vector


class TwoSidedArea(mi.Emitter):
    """An area light that shines to both sides of its surface, which Mitsuba's own ``area`` does not.

    ``radiance`` (texture): emitted radiance, the same in all directions. It cannot start light paths (``sample_ray``).
    """

    def __init__(self, props: Any) -> None:
        """Read the radiance.

        Args:
            props: Mitsuba properties with ``radiance``.
        """
        super().__init__(props)
        self.radiance = props.get_emissive_texture("radiance", 1.0)
        self.m_flags = int(mi.EmitterFlags.Surface)

    def eval(self, si: Any, active: Any = True) -> Any:
        """Evaluate the emitted radiance, as ``mi.Emitter.eval``.

        Args:
            si: Surface interactions.
            active: Active lanes.

        Returns:
            Radiance.
        """
        return self.radiance.eval(si, active)

    def sample_direction(self, it: Any, sample: Any, active: Any = True) -> tuple[Any, Any]:
        """Sample a direction towards the light, as ``mi.Emitter.sample_direction``.

        Args:
            it: Interactions to light.
            sample: 2D points in [0, 1)².
            active: Active lanes.

        Returns:
            Direction samples and radiance / density.
        """
        ds = self.get_shape().sample_direction(it, sample, active)
        ds.emitter = mi.EmitterPtr(self)
        weight = self.eval_direction(it, ds, active) / ds.pdf
        return ds, dr.select(active & (ds.pdf > 0), weight, 0)

    def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        """Compute the density of ``sample_direction``.

        Args:
            it: Interactions to light.
            ds: Direction samples.
            active: Active lanes.

        Returns:
            Density per solid angle.
        """
        return self.get_shape().pdf_direction(it, ds, active)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        """Evaluate the radiance along direction samples.

        Args:
            it: Interactions to light.
            ds: Direction samples.
            active: Active lanes.

        Returns:
            Radiance.
        """
        return self.radiance.eval(mi.SurfaceInteraction3f(ds, it.wavelengths), active)

    def traverse(self, callback: Any) -> None:
        """List the parameters, as ``mi.Object.traverse``.

        Args:
            callback: Receives the parameters.
        """
        callback.put("radiance", self.radiance, mi.ParamFlags.Differentiable)

    def to_string(self) -> str:
        """Describe the emitter.

        Returns:
            Its name and radiance.
        """
        return f"TwoSidedArea[{self.radiance}]"


class TexturedArea(TwoSidedArea):
    """A textured area light that shines to its front, sampled uniformly over its surface.

    Mitsuba's own ``area`` samples in proportion to the texture, for which it intersects the unwrapped mesh; with more
    than one call in a path tracer, Dr.Jit then writes one function twice into the program and LLVM ends the process
    ("invalid redefinition of function").
    """

    def eval(self, si: Any, active: Any = True) -> Any:
        """Evaluate the emitted radiance, 0 at the back.

        Args:
            si: Surface interactions.
            active: Active lanes.

        Returns:
            Radiance.
        """
        return dr.select(mi.Frame3f.cos_theta(si.wi) > 0, self.radiance.eval(si, active), 0)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        """Evaluate the radiance along direction samples, 0 at the back.

        Args:
            it: Interactions to light.
            ds: Direction samples.
            active: Active lanes.

        Returns:
            Radiance.
        """
        return dr.select(dr.dot(ds.d, ds.n) < 0, super().eval_direction(it, ds, active), 0)

    def to_string(self) -> str:
        """Describe the emitter.

        Returns:
            Its name and radiance.
        """
        return f"TexturedArea[{self.radiance}]"


mi.register_emitter("lightwell_two_sided_area", TwoSidedArea)
mi.register_emitter("lightwell_textured_area", TexturedArea)


def area_light(material: Material) -> tuple[Any, tuple[float, float, float]]:
    """Make the area emitter of an emissive material; both sides shine if the material is double-sided.

    Args:
        material: Emissive material.

    Returns:
        The Mitsuba emitter, and its mean radiance, linear RGB.
    """
    factor, texture = np.array(material.emissive, np.float32) * coverage(material), material.emissive_texture
    if texture is None:
        radiance: Any = {"type": "rgb", "value": factor.tolist()}
        mean = factor
    else:
        pixels = linear_pixels(texture.image, factor)
        radiance, mean = bitmap(pixels, texture), pixels.mean(axis=(0, 1), dtype=np.float64)
    one_sided = "area" if texture is None else "lightwell_textured_area"
    kind = "lightwell_two_sided_area" if material.double_sided else one_sided
    return mi.load_dict({"type": kind, "radiance": radiance}), vector(mean)


def coverage(material: Material) -> float:
    """Compute the mean alpha of a blended material: emission is blended with the background like its colour (glTF 2.0).

    Args:
        material: Material to inspect.

    Returns:
        Mean alpha in [0, 1]; 1 for materials that are not blended.
    """
    if material.alpha_mode != "BLEND":
        return 1.0
    texture = material.base_color_texture
    pixels = texture.image.pixels if texture else np.empty((0, 0, 3))
    return material.base_color[3] * (float(pixels[..., 3].mean()) / 255 if pixels.shape[2] > 3 else 1.0)


def punctual(light: Light) -> dict[str, Any]:
    """Describe a punctual light for Mitsuba: 1 cd is 1 W/sr, 1 lx is an irradiance of 1.

    The intensity of a spot decreases linearly with the angle between its cones, where glTF suggests a smoother curve.

    Args:
        light: Record of the light.

    Returns:
        Dictionary for ``mi.load_dict``.
    """
    power = (np.array(light.color, np.float64) * light.intensity).tolist()
    if light.kind == "point":
        return {"type": "point", "position": list(light.position), "intensity": {"type": "rgb", "value": power}}
    if light.kind == "directional":
        return {
            "type": "directional",
            "direction": list(light.direction),
            "irradiance": {"type": "rgb", "value": power},
        }
    origin, direction = np.array(light.position, np.float64), np.array(light.direction, np.float64)
    up = [1.0, 0.0, 0.0] if abs(direction[1]) > 0.9 * np.linalg.norm(direction) else [0.0, 1.0, 0.0]
    outer = float(np.degrees(light.outer_cone))
    target = (origin + direction).tolist()
    return {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(origin=origin.tolist(), target=target, up=up),
        "intensity": {"type": "rgb", "value": power},
        "cutoff_angle": outer,
        "beam_width": min(float(np.degrees(light.inner_cone)), outer * 0.999),
    }
