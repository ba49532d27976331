"""Lights of the records as Mitsuba emitters."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.assemble_textures import bitmap, linear_pixels
from lightwell.scenes.scene import Light, Material


class TwoSidedArea(mi.Emitter):
    """An area light that shines to both sides of its surface, which Mitsuba's own ``area`` does not.

    ``radiance`` (texture): emitted radiance, the same in all directions. It cannot start light paths (``sample_ray``).
    """

    def __init__(self, props):
        super().__init__(props)
        self.radiance = props.get_emissive_texture("radiance", 1.0)
        self.m_flags = int(mi.EmitterFlags.Surface)

    def eval(self, si, active=True):
        return self.radiance.eval(si, active)

    def sample_direction(self, it, sample, active=True):
        ds = self.get_shape().sample_direction(it, sample, active)
        ds.emitter = mi.EmitterPtr(self)
        weight = self.eval_direction(it, ds, active) / ds.pdf
        return ds, dr.select(active & (ds.pdf > 0), weight, 0)

    def pdf_direction(self, it, ds, active=True):
        return self.get_shape().pdf_direction(it, ds, active)

    def eval_direction(self, it, ds, active=True):
        return self.radiance.eval(mi.SurfaceInteraction3f(ds, it.wavelengths), active)

    def traverse(self, callback):
        callback.put("radiance", self.radiance, mi.ParamFlags.Differentiable)

    def to_string(self):
        return f"TwoSidedArea[{self.radiance}]"


class TexturedArea(TwoSidedArea):
    """An area light with a picture that shines to its front, sampled evenly over its surface.

    Mitsuba's own ``area`` samples in proportion to the picture, for which it intersects the unwrapped mesh; with more
    calls than one in a path tracer, Dr.Jit then writes one function twice into the program and LLVM ends the process
    ("invalid redefinition of function").
    """

    def eval(self, si, active=True):
        return dr.select(mi.Frame3f.cos_theta(si.wi) > 0, self.radiance.eval(si, active), 0)

    def eval_direction(self, it, ds, active=True):
        return dr.select(dr.dot(ds.d, ds.n) < 0, super().eval_direction(it, ds, active), 0)

    def to_string(self):
        return f"TexturedArea[{self.radiance}]"


mi.register_emitter("lightwell_two_sided_area", TwoSidedArea)
mi.register_emitter("lightwell_textured_area", TexturedArea)


def area_light(material: Material) -> tuple[Any, tuple[float, float, float]]:
    """Area emitter of an emissive material and its mean radiance; both sides shine if the material has both."""
    factor, texture = np.float32(material.emissive) * coverage(material), material.emissive_texture
    if texture is None:
        radiance: Any = {"type": "rgb", "value": factor.tolist()}
        mean = factor
    else:
        pixels = linear_pixels(texture.image, factor)
        radiance, mean = bitmap(pixels, texture), pixels.mean(axis=(0, 1), dtype=np.float64)
    one_sided = "area" if texture is None else "lightwell_textured_area"
    kind = "lightwell_two_sided_area" if material.double_sided else one_sided
    return mi.load_dict({"type": kind, "radiance": radiance}), tuple(float(c) for c in mean)


def coverage(material: Material) -> float:
    """Mean alpha of a blended material: emission is blended with what lies behind, as all of its colour (glTF 2.0)."""
    if material.alpha_mode != "BLEND":
        return 1.0
    texture = material.base_color_texture
    pixels = texture.image.pixels if texture else np.empty((0, 0, 3))
    return material.base_color[3] * (float(pixels[..., 3].mean()) / 255 if pixels.shape[2] > 3 else 1.0)


def punctual(light: Light) -> dict[str, Any]:
    """Mitsuba's description of a punctual light: 1 cd is 1 W/sr, 1 lx is an irradiance of 1.

    A spot falls off linearly with the angle between its cones, where glTF suggests a smoother curve.
    """
    power = (np.float64(light.color) * light.intensity).tolist()
    if light.kind == "point":
        return {"type": "point", "position": list(light.position), "intensity": {"type": "rgb", "value": power}}
    if light.kind == "directional":
        return {
            "type": "directional",
            "direction": list(light.direction),
            "irradiance": {"type": "rgb", "value": power},
        }
    origin, direction = np.float64(light.position), np.float64(light.direction)
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
