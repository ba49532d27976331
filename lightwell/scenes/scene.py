"""Records of a scene: frozen dataclasses that every loader fills and every later stage reads.

Notation: V vertices, T triangles, all coordinates in world space and metres, +Y up, colours linear sRGB, radiance
relative (a light of 1 cd at 1 m gives an irradiance of 1).
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from PIL import Image as PillowImage

from lightwell.core.image_io import eight_bits
from lightwell.core.notebook import card, png_uri
from lightwell.scenes.clip_mover import ClipMotion
from lightwell.scenes.executor import RowExecutor
from lightwell.scenes.light_clips import NO_CLIPS, LightClips
from lightwell.scenes.movers import Mover
from lightwell.scenes.scene_cache import Derived, SceneCache

# Reflectance of a dielectric with an index of refraction of 1.5 at normal incidence (glTF 2.0, appendix B).
DIELECTRIC_F0 = 0.04

AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]
LightKind = Literal["point", "spot", "directional"]

BOUNDS = Derived[np.ndarray]("scene.bounds")
CORE = Derived[np.ndarray]("scene.core")
# Parameters of Mitsuba's emitters that say how bright they are.
BRIGHTNESS = frozenset(f"{name}.{of}" for name in ("radiance", "intensity", "irradiance") for of in ("value", "data"))
# A scene as long as this, metres, may be ground or sky for the most part: its core is where its objects are, if they
# take at most this share of its longest edge. Meshes of more than half the edge and few triangles are ground or sky.
LARGE_SCENE, CORE_SHARE, HUGE_SHARE, SIMPLE_TRIANGLES = 100.0, 0.25, 0.5, 2048
# Share of the triangles of a huge mesh of many that may lie outside, at either end; and what is added around the core,
# relative to its longest edge.
CORE_OUTLIERS, CORE_MARGIN = 0.02, 0.15


@dataclass(frozen=True)
class Image:
    """An encoded image, stored as its author wrote it."""

    name: str
    data: bytes
    """Encoded bytes."""
    mime: Literal["image/png", "image/jpeg"]

    @cached_property
    def pixels(self) -> np.ndarray:
        """Decoded pixels.

        Returns:
            [height, width, 4] uint8, first row at the top, as stored (sRGB-encoded for colours).
        """
        with warnings.catch_warnings():
            # Loaders limit the size of images; Pillow's own, lower limit only warns.
            warnings.simplefilter("ignore", PillowImage.DecompressionBombWarning)
            return np.asarray(eight_bits(PillowImage.open(io.BytesIO(self.data))).convert("RGBA"))


@dataclass(frozen=True)
class Texture:
    """An image and its mapping to a surface. glTF convention: v = 0 is the top row."""

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
    """A metallic-roughness material for rasterisation; the learned radiance is divided by its reflectance.

    Textures multiply the factors beside them (glTF 2.0 rules). For Mitsuba scenes it is the most similar such material;
    ``approximate`` then lists the differences. The path tracer always uses the scene's own BSDF.
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
    """Emitted radiance, strength included."""
    emissive_texture: Texture | None = None
    dark_back: bool = False
    """The back emits nothing, whatever ``double_sided`` says: an area emitter of Mitsuba."""
    alpha_mode: AlphaMode = "OPAQUE"
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    transmission: float = 0.0
    thickness: float = 0.0
    """Thickness of a transmissive surface (KHR_materials_volume): 0 is thin-walled, else it bounds a solid."""
    ior: float = 1.5
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    sheen: float = 0.0
    specular_tint: float = 0.0
    unlit: bool = False
    delta: bool = False
    """The path tracer's BSDF has a delta or near-delta lobe (mirror, clear glass): caustics may be missing."""
    approximate: str = ""
    """Properties of the scene's own BSDF that this record cannot represent; empty when exact."""


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
    medium: bool = False
    """A medium fills it, so that nothing is seen through it; only light maps know its light."""

    def __repr__(self) -> str:
        return f"<Mesh {self.name}: {len(self.indices):,} triangles, material {self.material}>"

    @property
    def triangle_areas(self) -> np.ndarray:
        """[T] float64, square metres."""
        a, b, c = (self.positions[self.indices[:, k]].astype(np.float64) for k in range(3))
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1)


@dataclass(frozen=True)
class Light:
    """A punctual light of the scene (KHR_lights_punctual units)."""

    kind: LightKind
    name: str = ""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """Unit direction in which the light shines."""
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


@dataclass(frozen=True)
class SceneNode:
    """A node of the scene's tree: what moves together."""

    name: str
    parent: int
    """Index into ``Scene.nodes``; -1 for a root. Parents come first."""
    matrix: np.ndarray = field(repr=False)
    """[4, 4] float64, from the node's space to the world, metres."""
    meshes: tuple[int, ...] = ()
    """Its own meshes, indices into ``Scene.meshes``; those of its children are theirs."""
    lights: tuple[int, ...] = ()
    """Its own lights, indices into ``Scene.lights``."""
    cameras: tuple[str, ...] = ()
    """Names of its own cameras."""


@dataclass
class Scene:
    """A loaded scene: lights and surfaces as records and as a Mitsuba scene."""

    name: str
    meshes: list[Mesh]
    materials: list[Material]
    mi: Any
    """``mitsuba.Scene`` with one triangle mesh per entry of ``meshes``, in that order, and the static emitters."""
    lights: list[Light] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    """What could not be represented; each names the material or node."""
    vary: tuple[str, ...] = ()
    """Declarations by the scene's author, in the syntax of ``--vary``; used where nothing else is declared."""
    source: str = ""
    """Path it was loaded from, or 'builtin:NAME'."""
    digest: str = ""
    """Hash of everything that changes the transport (file contents); identifies checkpoints."""
    whole: Callable[[], Any] | None = None
    """Makes the ``mitsuba.Scene`` of a Mitsuba file as its author wrote it, with media; None for other files."""
    nodes: tuple[SceneNode, ...] = field(default=(), repr=False)
    """The tree of nodes, parents first; none for Mitsuba files."""
    clips: tuple[str, ...] = ()
    """Names of the animations of the file; the scene is loaded at rest."""
    read_clip: Callable[[int], ClipMotion] | None = field(default=None, repr=False, compare=False)
    """Reads one of them; None: there are none."""
    light_clips: LightClips = field(default=NO_CLIPS, repr=False, compare=False)
    """Those of the animations that change lights."""
    movers: tuple[Mover, ...] = ()
    """What a bake moves (``lightwell.scenes.posing``). The records are at rest."""
    surrounding: Any = field(default=None, repr=False, compare=False)
    """``mitsuba.Emitter`` of the environment map where that turns (``lightwell.transport.environment``): it is then no
    emitter of ``mi``. None: what surrounds the scene stands still."""
    executor: RowExecutor | None = field(default=None, init=False, repr=False, compare=False)
    """Where work on the scene runs that can be divided by rows; None: in this process."""
    cache: SceneCache = field(default_factory=SceneCache, init=False, repr=False, compare=False)
    """Results derived from this scene; a scene made by ``dataclasses.replace`` begins with none."""

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

    @property
    def core(self) -> np.ndarray:
        """[2, 3] float64: the part of the bounds in which people look around: all of it, but for ground of kilometres
        and domes of sky."""
        return self.cache.get(CORE, self._core)

    @property
    def core_extent(self) -> float:
        """Longest edge of the core, metres: what is small in a room is small beside this, not beside its sky dome."""
        return float((self.core[1] - self.core[0]).max())

    def _core(self) -> np.ndarray:
        boxes = [] if self.extent < LARGE_SCENE else [box for mesh in self.meshes if (box := self._detail(mesh))]
        if not boxes:
            return self.bounds
        low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
        edge = float((high - low).max())
        if not 0 < edge <= CORE_SHARE * self.extent:
            return self.bounds
        margin = CORE_MARGIN * edge
        low, high = np.maximum(low - margin, self.bounds[0]), np.minimum(high + margin, self.bounds[1])
        return np.stack([low, high]).astype(np.float64)

    def _detail(self, mesh: Mesh) -> tuple[np.ndarray, np.ndarray] | None:
        """Bounds of a mesh that is an object; None for ground and sky."""
        low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
        if (high - low).max() < HUGE_SHARE * self.extent:
            return low, high
        if len(mesh.indices) < SIMPLE_TRIANGLES:
            return None
        low, high = np.quantile(mesh.positions[mesh.indices].mean(axis=1), [CORE_OUTLIERS, 1 - CORE_OUTLIERS], axis=0)
        return low, high

    def __repr__(self) -> str:
        triangles = sum(len(mesh.indices) for mesh in self.meshes)
        size = " x ".join(f"{edge:.3g}" for edge in self.bounds[1] - self.bounds[0])
        return f"<Scene {self.name}: {triangles:,} triangles, {len(self.materials)} materials, {size} m>"

    def _repr_html_(self) -> str:
        """A picture of the surfaces, counts and bounds, for notebooks."""
        from lightwell.scenes.preview import preview

        triangles = sum(len(mesh.indices) for mesh in self.meshes)
        low, high = (", ".join(f"{v:.3g}" for v in corner) for corner in self.bounds)
        facts = {"triangles": f"{triangles:,}", "materials": len(self.materials), "cameras": len(self.cameras)}
        facts |= {"light of its own": self.has_static_light, "bounds, metres": f"({low}) … ({high})"}
        facts |= {"warnings": len(self.warnings)}
        return card(self.name, list(facts.items()), pictures={"surfaces, lit from the camera": png_uri(preview(self))})

    @property
    def has_static_light(self) -> bool:
        """Whether anything in the scene itself emits light. Lamps of intensity 0 and emission by a black picture do
        not."""
        return any(map(_shines, self.mi.emitters()))


def _shines(emitter: Any) -> bool:
    """Whether a ``mitsuba.Emitter`` emits light: not if its brightness is a colour or a picture, and black."""
    from lightwell.backend import mi

    # Lights of a picture and a factor list the factor alone.
    picture = getattr(emitter, "radiance", None)
    if picture is not None and np.max(picture.mean()) == 0:
        return False
    held = mi.traverse(emitter)
    keys = [key for key in held.keys() if key in BRIGHTNESS]
    return not keys or any(np.asarray(held[key]).max() > 0 for key in keys)
