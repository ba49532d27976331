"""Assembly of a ``Scene`` from its records: meshes, materials and lights become a Mitsuba scene here only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.scenes.assemble_bsdf import Bsdfs, textures, uv_set
from lightwell.scenes.assemble_lights import AreaLights, punctual
from lightwell.scenes.assemble_meshes import checked, clean, mirrored_uv, mitsuba_mesh, warn_of_dropped
from lightwell.scenes.clip_mover import ClipMotion
from lightwell.scenes.errors import SceneError
from lightwell.scenes.light_clips import NO_CLIPS, LightClips
from lightwell.scenes.scene import Camera, Light, Material, Mesh, Scene, SceneNode


def assemble(
    name: str,
    meshes: Sequence[Mesh],
    materials: Sequence[Material],
    lights: Sequence[Light] = (),
    cameras: Sequence[Camera] = (),
    warnings: Sequence[str] = (),
    source: str = "",
    digest: str = "",
    environment: Any = None,
    *,
    bsdfs: Sequence[Any] | None = None,
    area_lights: Sequence[Any] | None = None,
    emitters: Sequence[Any] = (),
    nodes: Sequence[SceneNode] = (),
    clips: Sequence[str] = (),
    read_clip: Callable[[int], ClipMotion] | None = None,
    light_clips: LightClips = NO_CLIPS,
) -> Scene:
    """Build a ``Scene`` whose Mitsuba scene holds one mesh per entry of ``Scene.meshes``, in that order.

    Triangles without area are dropped (with a warning), so ``Scene.meshes`` may differ from ``meshes``. A surface whose
    material is emissive becomes an area light that shines to its front, or to both sides if it is double-sided. A mesh
    or light that cannot be used raises ``SceneError``.

    Args:
        name: Name of the scene in messages.
        meshes: Meshes of the scene.
        materials: Materials that the meshes refer to.
        lights: Punctual lights.
        cameras: Cameras of the author.
        warnings: Warnings found so far; those of the assembly are appended to a copy.
        source: Path that the scene was loaded from, or 'builtin:NAME'.
        digest: Hash of everything that changes the transport.
        environment: A Mitsuba emitter, or the dictionary of one, that surrounds the scene.
        bsdfs: Per mesh, a Mitsuba BSDF to use instead of the one made from its material, or None.
        area_lights: Per mesh, a Mitsuba area emitter to use instead of the one made from its material, or None.
        emitters: Further Mitsuba emitters, used unchanged.
        nodes: Tree of nodes, whose meshes are indices into ``meshes``.
        clips: Names of the animations of the file.
        read_clip: Reads one of them by its number.
        light_clips: Those that change lights.

    Returns:
        The scene.
    """
    found = list(warnings)
    warn = found.append
    kept = _kept(name, meshes, len(materials), warn)
    description: dict[str, Any] = {"type": "scene"}
    records = _add_shapes(description, kept, materials, bsdfs, area_lights, warn)
    _add_emitters(description, lights, environment, emitters, warn)
    built = mi.load_dict(description, optimize=False)
    index_of = {number: index for index, (number, _) in enumerate(kept)}
    return Scene(
        name=name,
        meshes=records,
        materials=list(materials),
        mi=built,
        lights=list(lights),
        cameras=list(cameras),
        warnings=list(dict.fromkeys(found)),
        source=source,
        digest=digest,
        nodes=tuple(_of_kept(node, index_of) for node in nodes),
        clips=tuple(clips),
        read_clip=read_clip if clips else None,
        light_clips=light_clips,
    )


def _of_kept(node: SceneNode, index_of: dict[int, int]) -> SceneNode:
    """The node with the indices of the meshes that were kept."""
    return replace(node, meshes=tuple(index_of[mesh] for mesh in node.meshes if mesh in index_of))


def _kept(
    name: str, meshes: Sequence[Mesh], material_count: int, warn: Callable[[str], None]
) -> list[tuple[int, Mesh]]:
    """Check and clean meshes; returns (index in ``meshes``, mesh) of every one that has a triangle."""
    whole = [checked(name, mesh, material_count) for mesh in meshes]
    points = [m.positions for m in whole if len(m.positions)]
    low, high = (
        (np.min([p.min(axis=0) for p in points], axis=0), np.max([p.max(axis=0) for p in points], axis=0))
        if points
        else (0, 0)
    )
    extent = float(np.max(np.subtract(high, low, dtype=np.float64), initial=0.0))
    cleaned = [(i, clean(mesh, extent)) for i, mesh in enumerate(whole)]
    warn_of_dropped([(whole[i], mesh) for i, mesh in cleaned], warn)
    kept = [(i, mesh) for i, mesh in cleaned if mesh is not None]
    if not kept:
        raise SceneError(f"scene '{name}': has no triangles; a scene needs at least one surface, export its meshes too")
    return kept


def _add_shapes(
    description: dict[str, Any],
    kept: Sequence[tuple[int, Mesh]],
    materials: Sequence[Material],
    bsdfs: Sequence[Any] | None,
    area_lights: Sequence[Any] | None,
    warn: Callable[[str], None],
) -> list[Mesh]:
    """Add the Mitsuba mesh of each record; returns the records with their emission."""
    factory, glowing, records = Bsdfs(list(materials), warn), AreaLights(), list[Mesh]()
    for number, mesh in kept:
        own_bsdf = bsdfs[number] if bsdfs is not None else None
        own_light = area_lights[number] if area_lights is not None else None
        record, shape = _shape(mesh, materials[mesh.material], factory, glowing, own_bsdf, own_light)
        description[f"mesh_{len(records):06d}"] = shape
        records.append(record)
    return records


def _shape(
    mesh: Mesh, material: Material, factory: Bsdfs | None, glowing: AreaLights, own_bsdf: Any, own_light: Any
) -> tuple[Mesh, Any]:
    """Make the Mitsuba mesh of a record; returns the record with its emission, and the mesh. Without a factory the BSDF
    is one that a factory has made."""
    uv = (mesh.uv0, mesh.uv1)[min(uv_set(material), 1)]
    colors = alpha = None
    if mesh.colors is not None:
        # With a texture, the factor is multiplied into the texture; without one, into the vertex colours here.
        factor = 1 if material.base_color_texture is not None else np.array(material.base_color[:3], np.float32)
        colors = mesh.colors[:, :3] * factor
        if material.alpha_mode != "OPAQUE" and mesh.colors[:, 3].min() < 1:
            alpha = np.clip(mesh.colors[:, 3:], 0, 1)
    if own_bsdf is None or factory is None:
        mirrored = mirrored_uv(mesh, uv)
        if factory is not None:
            flags = {"colors": colors is not None, "alpha": alpha is not None, "relief": uv is not None}
            own_bsdf = factory(mesh.material, **flags, mirrored=mirrored)
        # Mitsuba generates coordinates for a mesh without any; viewers sample the texture at (0, 0).
        if uv is None and textures(material):
            uv = np.zeros((len(mesh.positions), 2), np.float32)
    if own_light is None and max(material.emissive) > 0:
        own_light, emission = glowing(material)
        mesh = replace(mesh, emission=emission)
    shape = mitsuba_mesh(mesh, own_bsdf, emitter=own_light, uv=uv, colors=colors, alpha=alpha)
    return mesh, shape


def posed_mesh(mesh: Mesh, material: Material, shape: Any, glowing: AreaLights) -> Any:
    """Make the Mitsuba mesh of a moved mesh.

    Args:
        mesh: The mesh in its pose.
        material: Its material.
        shape: The Mitsuba mesh at rest, whose BSDF is shared.
        glowing: Makes its area light if it has one.

    Returns:
        The Mitsuba mesh.
    """
    return _shape(mesh, material, None, glowing, shape.bsdf(), None)[1]


def _add_emitters(
    description: dict[str, Any],
    lights: Sequence[Light],
    environment: Any,
    emitters: Sequence[Any],
    warn: Callable[[str], None],
) -> None:
    for i, light in enumerate(lights):
        if light.range is not None:
            warn(
                f"light '{light.name or i}': its range of {light.range:g} m is ignored; light falls off with distance²"
            )
        description[f"light_{i:06d}"] = punctual(light)
    for i, emitter in enumerate(emitters):
        description[f"emitter_{i:06d}"] = emitter
    if environment is not None:
        description["environment"] = environment
