"""Applies edits to a scene: surfaces moved, lamps dimmed, materials painted."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.core.scene_edits import Paint, SceneEdits, Triple
from lightwell.scenes.scene import Material, Mesh, Scene

# Ends of the names of BSDF parameters that hold a colour, and of those that hold a roughness.
COLOURS = ("reflectance", "base_color", "diffuse_reflectance")
ROUGHNESSES = ("roughness", "alpha", "alpha_u", "alpha_v")


def edited(scene: Scene, edits: SceneEdits) -> Scene:
    """Apply edits to a scene that was just loaded.

    Args:
        scene: The scene; its Mitsuba shapes are changed in place, so that it is not to be used any more.
        edits: Edits, whose indices are of this scene.

    Returns:
        The edited scene, with a digest of its own; ``scene`` itself without an edit.

    Raises:
        ValueError: The scene has no mesh or material of an index, or a mesh that is dimmed does not shine; one line.
    """
    if not edits:
        return scene
    _check(scene, edits)
    shapes, meshes, materials = scene.mi.shapes(), list(scene.meshes), list(scene.materials)
    for index, paint in edits.painted.items():
        materials[index] = painted_material(materials[index], paint)
        for bsdf in bsdfs_of(scene, index):
            paint_bsdf(mi.traverse(bsdf), paint, {})
    for index, by in edits.moved.items():
        translate(mi.traverse(shapes[index]), "", np.asarray(by))
        meshes[index] = replace(meshes[index], positions=(meshes[index].positions + np.asarray(by)).astype(np.float32))
    for index, factor in edits.dimmed.items():
        dim(mi.traverse(shapes[index]), "emitter.", factor)
        meshes[index], own = _dimmed(meshes[index], materials, factor)
        materials.extend(own)
    about = hashlib.sha256(edits.to_json().encode()).hexdigest()[:32]
    digest = f"{scene.digest} edited by {about}" if scene.digest else ""
    return replace(scene, meshes=meshes, materials=materials, mi=mi.load_dict(content_of(scene)), digest=digest)


def _check(scene: Scene, edits: SceneEdits) -> None:
    """Refuse the edits of another scene."""
    shapes = scene.mi.shapes()
    for what, indices, count in (
        ("mesh", (*edits.moved, *edits.dimmed), len(scene.meshes)), ("material", edits.painted, len(scene.materials))
    ):  # fmt: skip
        for index in indices:
            if index >= count:
                raise ValueError(f"edits: scene '{scene.name}' has no {what} {index}; these are edits of another scene")
    for index in edits.dimmed:
        if shapes[index].emitter() is None:
            raise ValueError(
                f"edits: mesh {index} of scene '{scene.name}' is no lamp; these are edits of another scene"
            )


def content_of(scene: Scene) -> dict[str, Any]:
    """Describe the shapes and lights of a scene as Mitsuba's dictionary; the objects are shared.

    Args:
        scene: The scene.

    Returns:
        'shape0' … in the order of ``Scene.meshes``, and 'emitter0' … for the lights that are no surfaces.
    """
    content: dict[str, Any] = {"type": "scene"}
    content |= {f"shape{k}": shape for k, shape in enumerate(scene.mi.shapes())}
    # Area lights come with their shapes.
    others = [e for e in scene.mi.emitters() if not mi.has_flag(e.flags(), mi.EmitterFlags.Surface)]
    return content | {f"emitter{k}": emitter for k, emitter in enumerate(others)}


def bsdfs_of(scene: Scene, material: int) -> list[Any]:
    """List the BSDFs of a material: meshes with vertex colours or mirrored coordinates have one of their own.

    Args:
        scene: The scene.
        material: Index of the material.

    Returns:
        Mitsuba BSDFs, each once.
    """
    shapes = scene.mi.shapes()
    found = [shapes[k].bsdf() for k, mesh in enumerate(scene.meshes) if mesh.material == material]
    return list({id(bsdf): bsdf for bsdf in found if bsdf is not None}.values())


def paint_bsdf(parameters: Any, paint: Paint, before: dict[str, Any]) -> None:
    """Give a BSDF new properties, those that it has parameters of.

    Args:
        parameters: ``mi.traverse`` of the BSDF; updated.
        paint: New properties.
        before: Values as the file has them, by parameter; the first call adds them, and later ones start from them.
    """
    for key in [key for key in parameters.keys() if _is_color(key) or _is_roughness(key)]:
        first = before.setdefault(key, type(parameters[key])(parameters[key]))
        value = first
        if paint.color is not None and _is_color(key):
            value = _painted_color(first, key, paint.color)
        elif paint.roughness is not None and _is_roughness(key):
            # Plugins with ``alpha`` take the square of the roughness.
            squared = not any(part == "roughness" for part in key.split("."))
            value = type(first)(paint.roughness**2 if squared else paint.roughness)
        parameters[key] = type(first)(value)
    parameters.update()


def can_paint(bsdf: Any) -> bool:
    """Return whether a BSDF has a colour that can be painted.

    Args:
        bsdf: Mitsuba BSDF.

    Returns:
        True where it has a parameter of a colour.
    """
    return any(_is_color(key) for key in mi.traverse(bsdf).keys())


def _is_color(key: str) -> bool:
    *_, owner, last = ["", *key.split(".")]
    return owner in COLOURS and last in ("value", "data")


def _is_roughness(key: str) -> bool:
    names = key.split(".")
    return names[-1] in ROUGHNESSES or (len(names) > 1 and names[-2] in ROUGHNESSES and names[-1] == "value")


def _painted_color(first: Any, key: str, color: Triple) -> Any:
    """The painted value of a colour [3], a grey or a picture [H, W, C]."""
    if key.endswith(".data"):
        pixels = np.array(first)
        channels = np.ones(pixels.shape[-1], np.float32)
        channels[:3] = color[: len(channels[:3])]
        return mi.TensorXf(pixels * channels)
    return mi.Color3f(*color) if isinstance(first, mi.Color3f) else type(first)(float(np.mean(color)))


def painted_material(material: Material, paint: Paint) -> Material:
    """Give the record of a material new properties, as ``paint_bsdf`` does.

    Args:
        material: The record.
        paint: New properties.

    Returns:
        The painted record.
    """
    red, green, blue, alpha = material.base_color
    if paint.color is not None:
        factor = (red, green, blue) if material.base_color_texture is not None else (1.0, 1.0, 1.0)
        red, green, blue = (f * c for f, c in zip(factor, paint.color))
    roughness = material.roughness if paint.roughness is None else paint.roughness
    return replace(material, base_color=(red, green, blue, alpha), roughness=roughness)


def translate(parameters: Any, start: str, by: np.ndarray) -> None:
    """Move a Mitsuba mesh; its vertex normals stay as the file has them.

    Args:
        parameters: ``mi.traverse`` of the mesh, or of what holds it; updated.
        start: Start of the names of its parameters.
        by: [3] translation, metres.
    """
    key, normals = f"{start}vertex_positions", f"{start}vertex_normals"
    kept = np.array(parameters[normals]) if normals in parameters else np.zeros(0)
    places = np.array(parameters[key]).reshape(-1, 3) + np.asarray(by, np.float64)
    parameters[key] = mi.Float(places.astype(np.float32).ravel())
    parameters.update()
    if len(kept):
        # Mitsuba computes them anew when vertices move.
        parameters[normals] = mi.Float(kept.astype(np.float32).ravel())
        parameters.update()


def dim(parameters: Any, start: str, factor: float) -> None:
    """Multiply the emission of an emitter.

    Args:
        parameters: ``mi.traverse`` of the emitter, or of what holds it; updated.
        start: Start of the names of its parameters.
        factor: Factor, ≥ 0.
    """
    for key in list(parameters.keys()):
        if key.startswith(start) and key.endswith((".value", ".data")):
            parameters[key] = parameters[key] * factor
    parameters.update()


def _dimmed(mesh: Mesh, materials: Sequence[Material], factor: float) -> tuple[Mesh, list[Material]]:
    """A dimmed mesh, and the material of its own that it has then where its material emits light."""
    material = materials[mesh.material]
    emission, emissive = (_scaled(colour, factor) for colour in (mesh.emission, material.emissive))
    if not max(material.emissive) > 0:
        return replace(mesh, emission=emission), []
    return replace(mesh, emission=emission, material=len(materials)), [replace(material, emissive=emissive)]


def _scaled(color: Triple, factor: float) -> Triple:
    return color[0] * factor, color[1] * factor, color[2] * factor
