"""The scene as GLB, by Blender's own exporter."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy


def baked_objects(context) -> list[bpy.types.Object]:
    """List the objects that are baked.

    Args:
        context: Blender's context.

    Returns:
        Visible objects of the collection, or of the scene, without the movers.
    """
    settings = context.scene.lightwell
    chosen = settings.collection.all_objects if settings.collection else context.scene.objects
    movers = set(settings.movers.all_objects) if settings.movers else set()
    return [found for found in chosen if found not in movers and found.visible_get()]


@contextmanager
def _selected(context, chosen: list[bpy.types.Object]) -> Iterator[None]:
    """Select objects for the time of a block."""
    before = [found for found in context.view_layer.objects if found.select_get()]
    try:
        for found in context.view_layer.objects:
            found.select_set(found in chosen)
        yield
    finally:
        for found in context.view_layer.objects:
            found.select_set(found in before)


def export_scene(context, path: Path) -> None:
    """Write the objects that are baked.

    Args:
        context: Blender's context.
        path: GLB to write.

    Raises:
        ValueError: There is nothing to bake.
        RuntimeError: Blender's exporter failed.
    """
    chosen = baked_objects(context)
    if not any(found.type == "MESH" for found in chosen):
        raise ValueError("nothing to bake: no visible mesh in the collection")
    path.parent.mkdir(parents=True, exist_ok=True)
    with _selected(context, chosen):
        bpy.ops.export_scene.gltf(
            filepath=str(path),
            export_format="GLB",
            use_selection=True,
            export_apply=True,
            export_lights=True,
            export_cameras=True,
            export_animations=False,
            export_import_convert_lighting_mode="SPEC",
        )
