"""What a scene is in lightwell: the frozen records that every loader fills and every later stage reads.

Notation: V vertices, T triangles, all coordinates in world space and metres, +Y up, colours linear sRGB, radiance
relative (a light of 1 cd at 1 m gives an irradiance of 1).
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from typing import Any, Literal

import numpy as np
from PIL import Image as PillowImage

from lightwell.scenes.scene_cache import Derived, SceneCache

# Reflectance of a dielectric with an index of refraction of 1.5 at normal incidence (glTF 2.0, appendix B).
DIELECTRIC_F0 = 0.04

BOUNDS = Derived[np.ndarray]("scene.bounds")


@dataclass(frozen=True)
class Image:
    """An encoded picture, kept as its author stored it."""

    name: str
    data: bytes
    """Encoded bytes."""
    mime: Literal["image/png", "image/jpeg"]

    @cached_property
    def pixels(self) -> np.ndarray:
        """[height, width, 4] uint8, first row at the top, as stored (sRGB-encoded for colours)."""
        with warnings.catch_warnings():
            # Loaders bound the size of pictures; Pillow's own, lower bound only warns.
            warnings.simplefilter("ignore", PillowImage.DecompressionBombWarning)
            return np.asarray(PillowImage.open(io.BytesIO(self.data)).convert("RGBA"))


@dataclass(frozen=True)
class Texture:
    """A picture and how it is laid on a surface. glTF convention: v = 0 is the top row."""

    image: Image
    wrap: tuple[str, str] = ("repeat", "repeat")
    """Per axis: 'repeat', 'mirror' or 'clamp'."""
    nearest: bool = False
    """Nearest instead of bilinear filter."""
    uv_set: int = 0
    transform: tuple[tuple[float, ...], ...] | None = None
    """3x3 matrix of KHR_texture_transform applied to (u, v, 1), or None."""


@dataclass(frozen=True)
class Material:
    """A metallic-roughness material: what the rasteriser shows and by what the learned radiance is divided.

    Textures multiply the factors beside them (glTF 2.0 rules). For Mitsuba scenes it is the nearest such material;
    ``approximate`` then says what was lost. The path tracer always uses the scene's own BSDF.
    """

    name: str
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    base_color_texture: Texture | None = None
    metallic: float = 1.0
    roughness: float = 1.0
    """glTF (perceptual) roughness; the microfacet alpha is its square."""
    metallic_roughness_texture: Texture | None = None
    """G is roughness, B is metallic, linear."""
    normal_texture: Texture | None = None
    normal_scale: float = 1.0
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Radiance, strength multiplied in."""
    emissive_texture: Texture | None = None
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    transmission: float = 0.0
    thickness: float = 0.0
    """Of a transmissive surface (KHR_materials_volume): 0 is thin-walled, else it bounds a solid that refracts."""
    ior: float = 1.5
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    sheen: float = 0.0
    specular_tint: float = 0.0
    unlit: bool = False
    delta: bool = False
    """The path tracer's BSDF has a delta or near-delta lobe (mirror, clear glass): caustics may be missing."""
    approximate: str = ""
    """What this record cannot say of the scene's own BSDF; empty when exact."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of one material. ``Scene.mi.shapes()[i]`` is the same surface as ``Scene.meshes[i]``."""

    name: str
    positions: np.ndarray
    """[V, 3] float32, world space."""
    indices: np.ndarray
    """[T, 3] uint32."""
    material: int
    """Index into ``Scene.materials``."""
    normals: np.ndarray | None = None
    """[V, 3] float32, unit; None: flat shading."""
    uv0: np.ndarray | None = None
    """[V, 2] float32, glTF convention (v down)."""
    uv1: np.ndarray | None = None
    colors: np.ndarray | None = None
    """[V, 4] float32 linear, multiplies the base colour."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Mean emitted radiance when the surface is a light, else 0."""

    @property
    def triangle_areas(self) -> np.ndarray:
        """[T] float64, square metres."""
        a, b, c = (self.positions[self.indices[:, k]].astype(np.float64) for k in range(3))
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1)


@dataclass(frozen=True)
class Light:
    """A punctual light that stands in the scene (KHR_lights_punctual units)."""

    kind: Literal["point", "spot", "directional"]
    name: str = ""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """Where the light shines to; unit."""
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    """Candela for point and spot, lux for directional."""
    range: float | None = None
    inner_cone: float = 0.0
    outer_cone: float = 0.7853981633974483
    """Radians, half angles."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov_y: float = 50.0
    """Vertical field of view, degrees."""
    name: str = ""


@dataclass
class Scene:
    """A loaded scene: light and surfaces, once as records and once as a Mitsuba scene."""

    name: str
    meshes: list[Mesh]
    materials: list[Material]
    mi: Any
    """``mitsuba.Scene`` with one triangle mesh per entry of ``meshes``, in that order, and the static emitters."""
    lights: list[Light] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    """What could not be expressed, each naming the material or node."""
    vary: tuple[str, ...] = ()
    """What the scene's author suggests may move, in the words of ``--vary``; used where nothing else is declared."""
    source: str = ""
    """Path it was loaded from, or 'builtin:NAME'."""
    digest: str = ""
    """Hash of everything that changes the transport (file contents); identifies checkpoints."""
    whole: Callable[[], Any] | None = None
    """Makes the ``mitsuba.Scene`` of a Mitsuba file as its author wrote it, media and all; None for other files."""
    cache: SceneCache = field(default_factory=SceneCache, init=False, repr=False, compare=False)
    """What has been worked out from this scene; a scene that ``dataclasses.replace`` makes begins with none."""

    @property
    def bounds(self) -> np.ndarray:
        """[2, 3] float64: smallest and largest corner of the geometry."""
        return self.cache.get(BOUNDS, self._bounds)

    def _bounds(self) -> np.ndarray:
        low = np.min([m.positions.min(axis=0) for m in self.meshes], axis=0)
        high = np.max([m.positions.max(axis=0) for m in self.meshes], axis=0)
        return np.stack([low, high]).astype(np.float64)

    @property
    def center(self) -> np.ndarray:
        """[3] middle of the bounds."""
        return self.bounds.mean(axis=0)

    @property
    def extent(self) -> float:
        """Longest edge of the bounds, metres."""
        return float((self.bounds[1] - self.bounds[0]).max())

    def _repr_html_(self) -> str:
        """Counts and bounds, for notebooks."""
        triangles = sum(len(mesh.indices) for mesh in self.meshes)
        low, high = (", ".join(f"{v:.3g}" for v in corner) for corner in self.bounds)
        facts = {"triangles": f"{triangles:,}", "materials": len(self.materials), "cameras": len(self.cameras)}
        facts |= {"light of its own": self.has_static_light, "bounds, metres": f"({low}) … ({high})"}
        facts |= {"warnings": len(self.warnings)}
        rows = "".join(f"<tr><td>{escape(k)}</td><td>{escape(str(v))}</td></tr>" for k, v in facts.items())
        return f"<b>{escape(self.name)}</b><table>{rows}</table>"

    @property
    def has_static_light(self) -> bool:
        """Whether anything in the scene itself emits light."""
        return len(self.mi.emitters()) > 0
