"""What the panels edit, kept in the scene."""

import math

import bpy

QUALITIES = (
    ("draft", "Draft", "About 30 seconds on two cores"),
    ("good", "Good", "About 3 minutes on two cores"),
    ("best", "Best", "About 20 minutes on two cores"),
)
FIELDS = (
    ("surface", "Follows a lamp", "Indirect light that follows a lamp or the sun"),
    ("lightmap", "Light maps", "Light of lamps that stand still; can be applied to materials"),
    ("probes", "Probes", "Irradiance probes for objects that move"),
)


def _is_lamp(_settings, candidate) -> bool:
    return candidate.type == "LIGHT" and candidate.data.type in ("POINT", "SPOT", "SUN")


class LightwellSettings(bpy.types.PropertyGroup):
    """Settings of a bake."""

    field: bpy.props.EnumProperty(name="Learn", items=FIELDS, default="surface")
    quality: bpy.props.EnumProperty(name="Quality", items=QUALITIES, default="good")
    budget: bpy.props.FloatProperty(
        name="Time",
        description="Time of the whole bake; 0 takes that of the quality",
        default=0.0,
        min=0.0,
        unit="TIME_ABSOLUTE",
    )
    lamp: bpy.props.PointerProperty(
        name="Lamp", description="Lamp or sun that the light follows", type=bpy.types.Object, poll=_is_lamp
    )
    reach: bpy.props.FloatVectorProperty(
        name="Reach",
        description="How far the lamp moves each way",
        default=(0.5, 0.5, 0.3),
        min=0.0,
        subtype="XYZ",
        unit="LENGTH",
    )
    sun_start: bpy.props.FloatVectorProperty(
        name="Sun from",
        description="Azimuth and elevation",
        size=2,
        default=(math.radians(90), math.radians(15)),
        unit="ROTATION",
    )
    sun_end: bpy.props.FloatVectorProperty(
        name="Sun to",
        description="Azimuth and elevation",
        size=2,
        default=(math.radians(270), math.radians(15)),
        unit="ROTATION",
    )
    collection: bpy.props.PointerProperty(
        name="Collection", description="What is baked; empty: the scene", type=bpy.types.Collection
    )
    movers: bpy.props.PointerProperty(
        name="Movers", description="Objects that move: they are left out of the bake", type=bpy.types.Collection
    )
    out: bpy.props.StringProperty(name="Output", default="//lightwell", subtype="DIR_PATH")


class LightwellPreferences(bpy.types.AddonPreferences):
    """Where lightwell is."""

    bl_idname = __package__

    program: bpy.props.StringProperty(
        name="Python with lightwell",
        description="Empty: the wheels of this extension, in Blender's own Python but in a process of its own",
        default="",
        subtype="FILE_PATH",
    )

    def draw(self, _context) -> None:
        """Draw the preferences."""
        self.layout.prop(self, "program")


CLASSES = (LightwellSettings, LightwellPreferences)
