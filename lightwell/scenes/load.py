"""Loading a scene: a builtin name, a glTF file or a Mitsuba XML file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from lightwell.scenes.errors import SceneError as SceneError
from lightwell.scenes.scene import Scene

BUILTINS = ("cornell", "courtyard", "two-rooms")
GLTF_SUFFIXES = (".gltf", ".glb")


def load(source: str | os.PathLike[str], *, allow_paths: Sequence[str | os.PathLike[str]] = ()) -> Scene:
    """The scene called ``source``: a name of ``BUILTINS``, or the path of a .glb, .gltf or Mitsuba .xml file.

    ``allow_paths``: folders beside its own whose files a Mitsuba scene may name (textures, meshes, includes).
    A scene without light is fine here; ``Scene.has_static_light`` tells. What could not be expressed is in
    ``Scene.warnings``. Raises SceneError, one line that says what is wrong and the cure.
    """
    if source in BUILTINS:
        from lightwell.scenes.builtin import build

        return build(str(source))
    path = Path(source)
    kind = path.suffix.lower()
    if kind not in (*GLTF_SUFFIXES, ".xml"):
        raise SceneError(
            f"scene '{path.name}': '{kind or 'no suffix'}' is not a scene; "
            f"give a .glb, .gltf or Mitsuba .xml file or one of {', '.join(BUILTINS)}"
        )
    if not path.is_file():
        raise SceneError(f"scene '{path.name}': there is no file '{path}'; check the path")
    if kind in GLTF_SUFFIXES:
        from lightwell.scenes.gltf import load_gltf

        return load_gltf(path)
    from lightwell.scenes.mitsuba_xml import load_mitsuba

    return load_mitsuba(path, allow_paths=allow_paths)
