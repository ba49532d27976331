"""Loading a scene: a builtin name, a glTF file, a Mitsuba XML file, or one that is converted to glTF."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from lightwell.core.scene_options import BUILTINS as BUILTINS
from lightwell.core.scene_options import CONVERTED_SUFFIXES, GLTF_SUFFIXES, check_source
from lightwell.limits import Limits
from lightwell.scenes.errors import SceneError as SceneError
from lightwell.scenes.scene import Scene


def load(
    source: str | os.PathLike[str],
    *,
    limits: Limits | None = None,
    unit: float = 1.0,
    allow_paths: Sequence[str | os.PathLike[str]] = (),
) -> Scene:
    """Load a builtin scene or a scene file.

    Args:
        source: A name of ``BUILTINS``, or the path of a .glb, .gltf or Mitsuba .xml file, or of a .usd, .obj, .ply or
            .blend file (``lightwell.scenes.converted``).
        limits: Limits on sizes and counts in the file; None: ``Limits()``.
        unit: Metres per unit of length of a glTF, OBJ or PLY file, > 0: 0.01 for a scene in centimetres.
        allow_paths: Further folders whose files a Mitsuba scene may name (textures, meshes, includes), besides its own.

    Returns:
        The scene in metres. It may have no light (see ``Scene.has_static_light``); what could not be represented is
        listed in ``Scene.warnings``.

    Raises:
        SceneError: One line that names the defect and the cure.

    Example:
        >>> scene = lightwell.load("cornell")
        >>> len(scene.meshes) > 5 and not scene.warnings
        True
    """
    try:
        return _load(source, limits or Limits(), unit, allow_paths)
    except MemoryError as error:
        raise SceneError(
            f"scene '{Path(source).name}': needs more memory than this machine has; simplify the scene"
        ) from error


def _load(
    source: str | os.PathLike[str], limits: Limits, unit: float, allow_paths: Sequence[str | os.PathLike[str]]
) -> Scene:
    if source in BUILTINS:
        from lightwell.scenes.builtin import build

        return build(str(source))
    try:
        check_source(source)
    except ValueError as error:
        raise SceneError(str(error)) from None
    path = Path(source)
    kind = path.suffix.lower()
    if kind in GLTF_SUFFIXES:
        from lightwell.scenes.gltf import load_gltf

        return load_gltf(path, limits, unit)
    if kind in CONVERTED_SUFFIXES:
        from lightwell.scenes.converted import load_converted

        return load_converted(path, limits, unit)
    if unit != 1:
        raise SceneError(f"scene '{path.name}': --scene-unit is for glTF files; scale a Mitsuba scene in its own file")
    from lightwell.scenes.mitsuba_xml import load_mitsuba

    return load_mitsuba(path, limits, allow_paths)
