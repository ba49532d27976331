"""Lights of the records as Mitsuba emitters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.assemble_textures import bitmap, linear_pixels
from lightwell.scenes.scene import Image, Light, Material, Texture
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.vectors import vector


class TwoSidedArea(mi.Emitter):
    """An area light that shines to both sides of its surface, which Mitsuba's own ``area`` does not.

    ``radiance`` (texture): emitted radiance, the same in all directions; ``factor`` (vector): what a picture is
    multiplied by, so that one picture serves many emitters. It cannot start light paths (``sample_ray``).
    """

    def __init__(self, props: Any) -> None:
        """Read the radiance.

        Args:
            props: Mitsuba properties with ``radiance``, and ``factor`` for a picture.
        """
        super().__init__(props)
        self.radiance = props.get_emissive_texture("radiance", 1.0)
        self.factor = mi.Color3f(props["factor"]) if "factor" in props else None
        dr.make_opaque(self.factor)
        self.m_flags = int(mi.EmitterFlags.Surface)

    def eval(self, si: Any, active: Any = True) -> Any:
        """Evaluate the emitted radiance, as ``mi.Emitter.eval``.

        Args:
            si: Surface interactions.
            active: Active lanes.

        Returns:
            Radiance.
        """
        radiance = self.radiance.eval(si, active)
        return radiance if self.factor is None else radiance * self.factor

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
        return TwoSidedArea.eval(self, mi.SurfaceInteraction3f(ds, it.wavelengths), active)

    def traverse(self, callback: Any) -> None:
        """List the parameters, as ``mi.Object.traverse``.

        Args:
            callback: Receives the parameters.
        """
        if self.factor is None:
            callback.put("radiance", self.radiance, mi.ParamFlags.Differentiable)
        else:
            # Not the picture, which other emitters have too.
            callback.put("radiance.value", self.factor, mi.ParamFlags.Differentiable)

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
        return dr.select(mi.Frame3f.cos_theta(si.wi) > 0, super().eval(si, active), 0)

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


class AreaLights:
    """Makes the area emitters of emissive materials; those of one picture share it."""

    def __init__(self) -> None:
        """Start without pictures."""
        # The images keep their ids; then the Mitsuba texture of the emission, and its mean.
        self._made: dict[tuple[Any, ...], tuple[Any, Any, np.ndarray]] = {}

    def __call__(self, material: Material) -> tuple[Any, tuple[float, float, float]]:
        """Make the area emitter of an emissive material; both sides shine if the material is double-sided.

        Args:
            material: Emissive material.

        Returns:
            The Mitsuba emitter, and its mean radiance, linear RGB.
        """
        factor, texture = np.array(material.emissive, np.float32), material.emissive_texture
        if texture is None:
            factor = factor * coverage(material)
            kind = "lightwell_two_sided_area" if material.double_sided else "area"
            light = {"type": kind, "radiance": {"type": "rgb", "value": factor.tolist()}}
            return mi.load_dict(light), vector(factor)
        cut = _cut_out(material, texture)
        factor = factor * (coverage(material) if cut is None else 1)
        radiance, mean = self._picture(texture, cut)
        kind = "lightwell_two_sided_area" if material.double_sided else "lightwell_textured_area"
        light = {"type": kind, "radiance": radiance, "factor": mi.ScalarVector3f(*factor.tolist())}
        return mi.load_dict(light), vector(mean * factor)

    def _picture(self, texture: Texture, cut: _CutOut | None) -> tuple[Any, np.ndarray]:
        """Mitsuba texture of an emission, and its mean."""
        key = (id(texture.image), texture.wrap, texture.nearest, texture.transform, cut and (id(cut.image), cut.least))
        if key not in self._made:
            pixels = linear_pixels(texture.image)
            if cut is not None:
                pixels = pixels * cut.shown()[..., None]
            mean = pixels.mean(axis=(0, 1), dtype=np.float64)
            self._made[key] = (texture.image, cut), bitmap(pixels, texture), mean
        return self._made[key][1:]


# Those of a scene in its poses.
AREA_LIGHTS = Derived[AreaLights]("scenes.area_lights")


@dataclass(frozen=True)
class _CutOut:
    """The cut-out of a material."""

    image: Image
    least: float
    """Stored alpha from which the surface is there, 0 to 255 or beyond."""

    def shown(self) -> np.ndarray:
        """[height, width] whether the surface is there."""
        return self.image.pixels[..., 3] >= self.least


def _cut_out(material: Material, emissive: Texture) -> _CutOut | None:
    """The cut-out whose texels are those of the emission; None where there is none, or texels differ."""
    base = material.base_color_texture
    if material.alpha_mode != "MASK" or base is None:
        return None
    return _CutOut(base.image, _least(material)) if _layout(base) == _layout(emissive) else None


def _layout(texture: Texture) -> tuple[Any, ...]:
    return texture.image.pixels.shape, texture.wrap, texture.uv_set, texture.transform


def _least(material: Material) -> float:
    """Stored alpha from which a cut-out material is there."""
    factor = material.base_color[3]
    return 255 * material.alpha_cutoff / factor if factor > 0 else (np.inf if material.alpha_cutoff > 0 else 0.0)


def coverage(material: Material) -> float:
    """Compute the share of a surface that emits: the mean alpha of a blended material, because emission is blended with
    the background like its colour (glTF 2.0), and what is left of a cut-out one.

    Args:
        material: Material to inspect.

    Returns:
        Share in [0, 1]; 1 for opaque materials.
    """
    texture, factor = material.base_color_texture, material.base_color[3]
    if material.alpha_mode == "OPAQUE":
        return 1.0
    if material.alpha_mode == "MASK":
        alone = factor >= material.alpha_cutoff
        return float(alone if texture is None else _CutOut(texture.image, _least(material)).shown().mean())
    return factor * (float(texture.image.pixels[..., 3].mean()) / 255 if texture is not None else 1.0)


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
