"""Panels in the render properties and in the sidebar of the 3D view."""

from __future__ import annotations

import bpy

from .operators import LIGHTWELL_OT_bake


def _draw(layout, context) -> None:
    settings = context.scene.lightwell
    layout.use_property_split = True
    for name in ("field", "quality", "budget", "collection", "movers", "out"):
        layout.prop(settings, name)
    if settings.field != "lightmap":
        layout.prop(settings, "lamp")
        if settings.lamp is not None:
            names = ("sun_start", "sun_end") if settings.lamp.data.type == "SUN" else ("reach",)
            for name in names:
                layout.prop(settings, name)
    if LIGHTWELL_OT_bake.running is not None:
        layout.operator("lightwell.cancel", icon="CANCEL")
        return
    row = layout.row(align=True)
    row.operator_context = "INVOKE_DEFAULT"
    row.operator("lightwell.bake", text="Preview", icon="SHADING_RENDERED").quality = "draft"
    row.operator("lightwell.bake", text="Bake", icon="RENDER_STILL")
    layout.operator("lightwell.open_page", icon="URL")
    if settings.field == "lightmap":
        layout.operator("lightwell.apply", icon="TEXTURE")


class LIGHTWELL_PT_render(bpy.types.Panel):
    """Panel in the render properties."""

    bl_label = "Lightwell"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context) -> None:
        """Draw the settings and buttons."""
        _draw(self.layout, context)


class LIGHTWELL_PT_sidebar(bpy.types.Panel):
    """Panel in the sidebar."""

    bl_label = "Lightwell"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Lightwell"

    def draw(self, context) -> None:
        """Draw the settings and buttons."""
        _draw(self.layout, context)


CLASSES = (LIGHTWELL_PT_render, LIGHTWELL_PT_sidebar)
