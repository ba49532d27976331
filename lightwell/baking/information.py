"""Facts about a baked asset or a scene."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Any


def describe(path: str, **loading: Any) -> dict[str, Any]:
    """Collect facts about a folder written by a bake, an asset, or any scene that can be loaded.

    Args:
        path: The folder, asset or scene.
        **loading: Options of ``lightwell.scenes.load``.

    Returns:
        JSON values.
    """
    target = Path(path)
    if (target / "scene.glb").is_file():
        target = target / "scene.glb"
    if target.suffix == ".glb" and target.is_file() and _is_baked(target):
        from lightwell.asset.info import info

        return info(target, loading.get("limits"))
    return _scene_facts(path, loading)


def _is_baked(path: Path) -> bool:
    from lightwell.asset.records import EXTENSION

    # Mapped, not read: what it holds is checked by its reader, within the limits.
    with path.open("rb") as file:
        if not path.stat().st_size:
            return False
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            return data.find(EXTENSION.encode()) >= 0


def _scene_facts(path: str, loading: dict[str, Any]) -> dict[str, Any]:
    from lightwell.scenes import load

    scene = load(path, **loading)
    low, high = scene.bounds.round(3).tolist()
    return {
        "scene": scene.name,
        "meshes": len(scene.meshes),
        "triangles": sum(len(mesh.indices) for mesh in scene.meshes),
        "materials": len(scene.materials),
        "lights": len(scene.mi.emitters()),
        "cameras": len(scene.cameras),
        "bounds": [low, high],
        "warnings": scene.warnings,
    }
