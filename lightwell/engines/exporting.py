"""`lightwell export OUT --to ENGINE`: a folder of files for an engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from lightwell.engines import bevy, godot, unity, unreal, web
from lightwell.engines.bake import Bake, read_bake
from lightwell.files import make_folder, write_atomically
from lightwell.limits import Limits

# Name of an engine to what writes its files.
ENGINES: Mapping[str, Callable[[Bake, Limits | None], dict[str, bytes]]] = {
    "godot": godot.files,
    "unity": unity.files,
    "unreal": unreal.files,
    "playcanvas": web.playcanvas_files,
    "babylon": web.babylon_files,
    "bevy": bevy.files,
    "threejs": web.three_files,
}


def export_engine(path: str | Path, to: str, out: str | Path, limits: Limits | None = None) -> list[Path]:
    """Write what an engine can take of a bake (docs/export.md says what that is).

    Args:
        path: A GLB, or the folder of a bake.
        to: One of ``ENGINES``.
        out: Folder to write into; files of earlier exports are replaced.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        Paths of the written files.

    Raises:
        ValueError: The engine is unknown, the asset is not valid, or it holds nothing that the engine can take.
    """
    if to not in ENGINES:
        raise ValueError(f"export: expected an engine of {', '.join(ENGINES)}, found '{to}'; choose one of them")
    bake = read_bake(path, limits)
    made = {"scene.glb": bake.path.read_bytes(), **ENGINES[to](bake, limits)}
    folder = make_folder(out)
    for name, data in made.items():
        make_folder((folder / name).parent)
        write_atomically(folder / name, data)
    return [folder / name for name in made]
