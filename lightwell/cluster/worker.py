"""What a worker computes: its fingerprint, and rows of a scene that it keeps in memory.

Dask sends the names of these functions with their arguments; a worker needs lightwell of the same version.
"""

from __future__ import annotations

import os
import platform
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import lightwell
from lightwell.cluster.work import MadeInputs, Order, Work
from lightwell.core.keys import digest
from lightwell.files import files_beside
from lightwell.scenes import load
from lightwell.scenes.executor import Arrays, Inputs
from lightwell.scenes.scene import Scene
from lightwell.transport.row_tasks import TASKS

# Scenes that a worker keeps. It computes under a lock: Mitsuba uses all threads of a process for one kernel.
MOST_SCENES = 2
_SCENES: OrderedDict[str, Scene] = OrderedDict()
_MADE = MadeInputs()
_LOCK = threading.Lock()
# The unit that every worker computes to show that its bytes are those of the others: points and paths.
POINTS, PATHS, SEED = 256, 16, 0xF1


@dataclass(frozen=True)
class SceneSource:
    """How to load a scene."""

    source: str
    """Built-in scene or path."""
    digest: str
    """``Scene.digest``."""
    loading: Mapping[str, Any] = field(default_factory=dict)
    """Options of ``lightwell.scenes.load``."""


def fingerprint() -> dict[str, str]:
    """Describe the machine, and compute a fixed unit.

    Returns:
        Versions, variant and processor, and ``bytes``, the hash of what was computed: workers with the same bytes give
        the same results.
    """
    import drjit
    import mitsuba

    from lightwell.backend import mi
    from lightwell.scenes.placing import sample_lights
    from lightwell.scenes.variables import declare
    from lightwell.transport import draw_surface, indirect

    with _LOCK:
        scene = load("cornell")
        variable = declare((), scene)
        lights = sample_lights(scene, variable, POINTS, SEED)
        a, b = indirect(scene, draw_surface(scene, POINTS, SEED).points, lights, variable, PATHS, SEED)
    return {
        "lightwell": lightwell.__version__,
        "mitsuba": mitsuba.__version__,
        "drjit": drjit.__version__,
        "variant": str(mi.variant()),
        "processor": platform.machine(),
        "bytes": digest(a.tobytes() + b.tobytes()),
    }


def take_scene(source: SceneSource, files: Mapping[str, bytes] | None = None) -> bool:
    """Load a scene, from its path or from files that are sent.

    Args:
        source: The scene.
        files: Contents by path relative to the scene's folder; None: read the path.

    Returns:
        Whether the worker has the scene now. False where its path does not exist here or holds another scene, and where
        the files that were sent cannot be loaded.

    Raises:
        ValueError: A file that is sent would lie outside of the scene's folder.
    """
    with _LOCK:
        if source.digest in _SCENES:
            return True
        if files is None:
            scene = _loaded(source.source, source)
        else:
            with tempfile.TemporaryDirectory() as folder:
                scene = _loaded(_written(files, Path(folder), Path(source.source).name), source)
        if scene is None or scene.digest != source.digest:
            return False
        _SCENES[source.digest] = scene
        while len(_SCENES) > MOST_SCENES:
            _SCENES.popitem(last=False)
        return True


def _loaded(path: str | Path, source: SceneSource) -> Scene | None:
    """The scene of a path; None where it cannot be loaded here, which asking again does not change."""
    try:
        return load(str(path), **source.loading)
    except (OSError, ValueError, RuntimeError):
        return None


def compute(work: Work, arrays: Arrays | None) -> tuple[str, Arrays | str]:
    """Compute rows.

    Args:
        work: The rows, or how they are made.
        arrays: Arrays [...] by name of the recipe, without one those that all rows share; None: there are none.

    Returns:
        Address of the worker, and the results [N, ...] by name, or the text of an error.
    """
    from distributed import get_worker

    address = str(get_worker().address)
    try:
        with _LOCK:
            order = work.unpacked()
            scene = _SCENES.get(order.scene)
            if scene is None:
                return address, NO_SCENE
            inputs: Inputs | None = Inputs(work.columns, arrays or {})
            if order.recipe is not None:
                inputs = _made(scene, order, work, arrays or {})
            if inputs is None:
                return address, OTHER_ROWS
            found = TASKS[order.task](scene, order.settings, inputs.columns, work.first, inputs.shared)
            return address, {name: np.ascontiguousarray(value) for name, value in found.items()}
    except Exception as error:  # Whatever a scene or a driver raises: the bake counts it and says it.
        return address, f"{type(error).__name__}: {' '.join(str(error).split())[:300]}" or "unknown error"


def _made(scene: Scene, order: Order, work: Work, arrays: Arrays) -> Inputs | None:
    """The inputs of a unit by its recipe; None where they are not those of the command, or cannot be made."""
    try:
        return _MADE.rows(scene, order, work, arrays)
    except Exception:  # A scene may differ in what its digest leaves out: then the rows are sent.
        return None


# Answer of a worker that was restarted and has lost the scene.
NO_SCENE = "the worker has no such scene"
# Answer of a worker whose recipe makes other rows than the command has.
OTHER_ROWS = "the worker makes other rows"


def scene_files(source: SceneSource, most: int = 1 << 30) -> dict[str, bytes]:
    """Read the files of a scene, for a worker that cannot read them.

    Args:
        source: The scene.
        most: Most bytes that are read.

    Returns:
        Contents by path relative to the scene's folder; empty for a built-in scene.

    Raises:
        ValueError: The folder of the scene holds more, or a file of it cannot be read; one line with the cure.
    """
    path = Path(source.source)
    if not path.is_file():
        return {}
    try:
        others: Iterable[tuple[Path, os.stat_result]] = () if path.suffix.lower() == ".glb" else files_beside(path)
        sizes = {path: path.stat().st_size} | {name: state.st_size for name, state in others}
        if sum(sizes.values()) > most:
            raise ValueError(
                f"cluster: the folder of '{path.name}' holds more than {most >> 20} MB; put the scene into a folder of "
                "its own, or into one that all machines share"
            )
        found = {name: _content(name) for name in sizes}
    except OSError as error:
        # Errors of the system are those of a lost connection elsewhere: this one would be tried again for ever.
        raise ValueError(
            f"cluster: cannot read '{error.filename}' for the workers ({error.strerror}); change its permissions, or "
            "put the scene into a folder of its own"
        ) from error
    return {os.fspath(name.relative_to(path.parent)): data for name, data in found.items() if data is not None}


def _content(path: Path) -> bytes | None:
    """Bytes of a file; None where it has vanished, as temporary files do."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None


def _written(files: Mapping[str, bytes], folder: Path, name: str) -> Path:
    root = folder.resolve()
    for relative, data in files.items():
        target = (root / relative).resolve()
        if not target.is_relative_to(root):
            raise ValueError(f"cluster: '{relative[:60]}' leads out of the scene's folder")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
    return root / name


def forget_inputs() -> None:
    """Forget the inputs that this worker has made by recipes."""
    _MADE.clear()
