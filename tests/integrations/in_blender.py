"""Runs inside Blender (a Python with bpy): in_blender.py EXTENSION FOLDER. Prints figures, then `all of it works`.

LIGHTWELL_PYTHON names a Python with lightwell, LIGHTWELL_BAKED the GLB of a light map: it is applied. With
LIGHTWELL_BAKE set, a bake is made and applied too.
"""

import os
import shutil
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import bpy

EXTENSION, FOLDER = sys.argv[-2:]
sys.path.insert(0, EXTENSION)
import lightwell_bake  # noqa: E402
from lightwell_bake import operators  # noqa: E402
from lightwell_bake.export import baked_objects  # noqa: E402

TIMER, ESCAPE = SimpleNamespace(type="TIMER"), SimpleNamespace(type="ESC")


def room() -> None:
    """A floor, a wall and a lamp in place of Blender's cube; a ball that moves."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=2)
    bpy.ops.mesh.primitive_plane_add(size=2, location=(0, 1, 1), rotation=(1.5708, 0, 0))
    bpy.ops.object.light_add(type="POINT", location=(0, 0, 1.5))
    bpy.context.scene.lightwell.lamp = bpy.context.object
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.2, location=(0.5, 0, 0.3))
    ball, movers = bpy.context.object, bpy.data.collections.new("movers")
    bpy.context.scene.collection.children.link(movers)
    movers.objects.link(ball)
    bpy.context.scene.lightwell.movers = movers


class Reported:
    """Stands for the operator's own object, which only a window can make: the functions of the class on plain data."""

    def __init__(self, quality: str = "draft") -> None:
        self.quality, self.lines = quality, []
        self._timer = None

    def report(self, kinds, text) -> None:
        self.lines.append((kinds, text))

    def __getattr__(self, name):
        found = getattr(operators.LIGHTWELL_OT_bake, name)
        return found.__get__(self) if callable(found) else found


def context(program: str) -> SimpleNamespace:
    """Blender's context with a window manager and preferences for a session without a window."""
    manager = SimpleNamespace(
        event_timer_add=lambda *words, **options: object(),
        event_timer_remove=lambda timer: None,
        modal_handler_add=lambda operator: None,
    )
    addons = {lightwell_bake.__name__: SimpleNamespace(preferences=SimpleNamespace(program=program))}
    return SimpleNamespace(
        scene=bpy.context.scene,
        view_layer=bpy.context.view_layer,
        window=None,
        workspace=None,
        window_manager=manager,
        preferences=SimpleNamespace(addons=addons),
    )


def drive(given, operator, escape_after: float | None = None) -> tuple[set, float, float]:
    """Send timer events until the operator ends: result, longest step, seconds from Esc to the end."""
    longest, pressed, start = 0.0, 0.0, time.monotonic()
    while True:
        event = TIMER
        if escape_after is not None and not pressed and time.monotonic() - start > escape_after:
            event, pressed = ESCAPE, time.monotonic()
        begin = time.perf_counter()
        result = operator.modal(given, event)
        longest = max(longest, time.perf_counter() - begin)
        if result & {"FINISHED", "CANCELLED"}:
            return result, longest, time.monotonic() - pressed if pressed else 0.0
        time.sleep(0.05)


def fake(folder: Path, body: str) -> str:
    """A program in place of Python with lightwell."""
    path = folder / f"fake{len(list(folder.glob('fake*')))}.sh"
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return str(path)


def apply(given: SimpleNamespace) -> None:
    """Put a light map on materials, and look at what they emit."""
    applied = Reported()
    assert operators.LIGHTWELL_OT_apply.execute(applied, given) == {"FINISHED"}, applied.lines
    image = bpy.data.images["lightwell"]
    assert image.size[0] == image.size[1] >= 16 and image.is_float and max(image.pixels) > 0.05
    found = bpy.data.collections["lightwell"].all_objects
    lit = [slot.material for thing in found if thing.type == "MESH" for slot in thing.material_slots]
    assert lit and all("lightwell" in material.node_tree.nodes for material in lit)
    [surface] = [node for node in lit[0].node_tree.nodes if node.type == "OUTPUT_MATERIAL"]
    assert surface.inputs["Surface"].links[0].from_node.type == "EMISSION"


def bake_and_apply(given: SimpleNamespace, opened: SimpleNamespace) -> None:
    """The whole way with lightwell itself."""
    settings = bpy.context.scene.lightwell
    settings.field, settings.budget = "lightmap", 20
    bake = Reported(quality="")
    assert bake.execute(given) == {"FINISHED"}, bake.lines
    assert operators.LIGHTWELL_OT_open.execute(opened, given) == {"FINISHED"}
    for kind in (bpy.data.images, bpy.data.collections):
        kind.remove(kind["lightwell"])
    apply(given)


def main() -> None:
    folder = Path(FOLDER)
    lightwell_bake.register()
    room()
    settings = bpy.context.scene.lightwell
    settings.out = str(folder / "out")
    assert [found.type for found in baked_objects(bpy.context)].count("MESH") == 2
    given = context(fake(folder, "sleep 30"))
    bake = Reported()
    assert bake.invoke(given, None) == {"RUNNING_MODAL"}
    assert not operators.LIGHTWELL_OT_bake.poll(given) and operators.LIGHTWELL_OT_cancel.poll(given)
    assert bake.modal(given, SimpleNamespace(type="MOUSEMOVE")) == {"PASS_THROUGH"}
    result, longest, seconds = drive(given, bake, escape_after=0.5)
    assert result == {"CANCELLED"} and bake.lines[-1] == ({"WARNING"}, "Cancelled"), bake.lines
    print(f"Blender {bpy.app.version_string.split()[0]}, longest step {1000 * longest:.1f} ms, cancel {seconds:.2f} s")
    assert operators.LIGHTWELL_OT_bake.poll(given) and (folder / "out/exported.glb").is_file()

    bake = Reported()
    bake.invoke(context(fake(folder, "echo 'lightwell: no room' >&2; exit 2")), None)
    assert drive(given, bake)[0] == {"CANCELLED"} and bake.lines[-1] == ({"ERROR"}, "lightwell: no room"), bake.lines
    missing = Reported()
    assert missing.invoke(context(str(folder / "nothing")), None) == {"CANCELLED"} and missing.lines[-1][0] == {"ERROR"}
    settings.collection = bpy.data.collections.new("empty")
    empty = Reported()
    assert empty.execute(given) == {"CANCELLED"} and "no visible mesh" in empty.lines[-1][1]
    settings.collection = None
    opened = SimpleNamespace(report=lambda kinds, text: print(kinds, text))
    assert operators.LIGHTWELL_OT_open.execute(opened, given) == {"CANCELLED"}

    if os.environ.get("LIGHTWELL_PYTHON"):
        given = context(os.environ["LIGHTWELL_PYTHON"])
        baked = folder / "out/baked"
        baked.mkdir(parents=True)
        shutil.copy(os.environ["LIGHTWELL_BAKED"], baked / "scene.glb")
        apply(given)
        if os.environ.get("LIGHTWELL_BAKE"):
            shutil.rmtree(baked)
            bake_and_apply(given, opened)
    lightwell_bake.unregister()
    assert not hasattr(bpy.types.Scene, "lightwell")
    print("all of it works", flush=True)


main()
# bpy 4.2 sometimes crashes when the interpreter frees it.
os._exit(0)
