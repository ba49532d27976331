"""Lightwell in Blender: bakes the scene's indirect light in a process of its own (docs/blender.md)."""

from __future__ import annotations

import bpy

from . import operators, panels, properties

CLASSES = (*properties.CLASSES, *operators.CLASSES, *panels.CLASSES)


def register() -> None:
    """Register everything with Blender."""
    for made in CLASSES:
        bpy.utils.register_class(made)
    bpy.types.Scene.lightwell = bpy.props.PointerProperty(type=properties.LightwellSettings)


def unregister() -> None:
    """Take everything back; a running bake is ended."""
    if operators.LIGHTWELL_OT_bake.running is not None:
        operators.LIGHTWELL_OT_bake.running.cancel()
        operators.LIGHTWELL_OT_bake.running = None
    del bpy.types.Scene.lightwell
    for made in reversed(CLASSES):
        bpy.utils.unregister_class(made)
