"""USD, OBJ, PLY and Blender files: converted to GLB in a process of their own, then read by the glTF reader.

The converters are other people's native code, and the files are strangers': a crash, a hang or too much memory ends the
process, not lightwell, and what the GLB asks for is counted against the limits like any glTF file.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lightwell.core.isolated import Worker, WorkerDied, WorkerError
from lightwell.core.scene_options import BLEND_SUFFIXES, MESH_SUFFIXES, USD_SUFFIXES
from lightwell.limits import Limits
from lightwell.scenes.clip_mover import ClipMotion
from lightwell.scenes.errors import SceneError
from lightwell.scenes.gltf import load_gltf
from lightwell.scenes.scene import Scene

# Suffix to the function that converts, the package that it needs, and the extra that brings it.
CONVERTERS = {
    **dict.fromkeys(USD_SUFFIXES, ("lightwell.scenes.convert_usd:convert", "pxr", "usd")),
    **dict.fromkeys(MESH_SUFFIXES, ("lightwell.scenes.convert_meshes:convert", "trimesh", "meshes")),
}
# Bytes of memory that a converter may use a byte that it may unpack to.
COPIES = 4
# Blender's own exporter; what it writes is what *File > Export > glTF 2.0* writes with lights and cameras.
BLENDER_PROGRAM = (
    "import bpy, sys; bpy.ops.export_scene.gltf(filepath=sys.argv[-1], export_format='GLB', export_cameras=True, "
    "export_lights=True, export_apply=True, export_import_convert_lighting_mode='SPEC')"
)


def load_converted(path: Path, limits: Limits, unit: float = 1.0) -> Scene:
    """Load a scene by way of GLB.

    Args:
        path: An existing file with a suffix of ``CONVERTERS`` or ``BLEND_SUFFIXES``.
        limits: Limits on sizes and counts.
        unit: Metres per unit, > 0; only OBJ and PLY files, which state none, may have another unit than 1.

    Returns:
        The scene; what was lost is in its warnings.

    Raises:
        SceneError: The file cannot be converted, or the package or program that does so is missing; one line.
    """
    place = f"scene '{path.name}'"
    if unit != 1 and path.suffix.lower() not in MESH_SUFFIXES:
        raise SceneError(f"{place}: states its own unit of length; leave --scene-unit out")
    limits.budget(place, SceneError).charge("file_bytes", path.stat().st_size)
    folder = tempfile.TemporaryDirectory(prefix="lightwell-")
    with ExitStack() as cleaning:
        cleaning.enter_context(folder)
        target = Path(folder.name) / "scene.glb"
        lost = (
            _blender(path, target, limits) if path.suffix.lower() in BLEND_SUFFIXES else _convert(path, target, limits)
        )
        try:
            scene = load_gltf(target, limits, unit)
        except SceneError as error:
            raise SceneError(str(error).replace("scene.glb", path.name)) from None
        if scene.read_clip is not None:
            # Clips are read when one is asked for: the file lives as long as the scene.
            cleaning.pop_all()
            scene = replace(scene, read_clip=_KeptClips(folder, scene.read_clip))
    return replace(scene, name=path.name, source=str(path), warnings=[*lost, *scene.warnings])


@dataclass(frozen=True)
class _KeptClips:
    """Reads the clips of a file in a temporary folder, and keeps the folder."""

    folder: tempfile.TemporaryDirectory[str]
    read: Callable[[int], ClipMotion]

    def __call__(self, number: int) -> ClipMotion:
        """The motion of an animation."""
        return self.read(number)


def _convert(path: Path, target: Path, limits: Limits) -> list[str]:
    """Write the GLB of a file; returns what was lost."""
    function, package, extra = CONVERTERS[path.suffix.lower()]
    place = f"scene '{path.name}'"
    if importlib.util.find_spec(package) is None:
        raise SceneError(
            f"{place}: {path.suffix} files need the package {package}; run: pip install 'lightwell[{extra}]'"
        )
    request = {"path": np.array(str(path.absolute())), "most_bytes": np.array(min(limits.file_bytes, 2**62))}
    memory = min(COPIES * limits.decoded_bytes, 2**40)
    try:
        with Worker(function, seconds=limits.seconds, memory=memory) as worker:
            answer = worker.ask(request, limits.decoded_bytes)
    except (WorkerDied, WorkerError) as error:
        raise SceneError(f"{place}: cannot be converted: {error}; export it as .glb") from None
    target.write_bytes(answer["glb"].tobytes())
    return [str(line) for line in answer["lost"]]


def _blender(path: Path, target: Path, limits: Limits) -> list[str]:
    """Export a .blend file with an installed Blender, or a Python that has bpy."""
    place = f"scene '{path.name}'"
    blender, python = os.environ.get("BLENDER") or shutil.which("blender"), os.environ.get("LIGHTWELL_BPY")
    if python:
        opened = (
            f"import bpy, sys; bpy.ops.wm.open_mainfile(filepath=sys.argv[-2], use_scripts=False); {BLENDER_PROGRAM}"
        )
        command = [python, "-c", opened, str(path.absolute()), str(target)]
    elif blender:
        options = ["--background", "--factory-startup", "--disable-autoexec"]
        command = [blender, *options, str(path.absolute()), "--python-expr", BLENDER_PROGRAM, "--", str(target)]
    else:
        raise SceneError(f"{place}: .blend files need Blender; install it, set BLENDER to it, or export it as .glb")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limits.seconds, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SceneError(f"{place}: Blender did not export it ({type(error).__name__}); export it as .glb") from None
    if done.returncode or not target.is_file():
        said = (done.stderr or done.stdout).strip().splitlines()
        raise SceneError(
            f"{place}: Blender did not export it: {said[-1][:160] if said else 'no message'}; export it as .glb"
        )
    return [
        "modifiers are applied; nodes other than Principled BSDF and pictures are lost, as in Blender's glTF export"
    ]
