"""Operators: bake with a timer, open the page, apply light maps."""

import os
import sys
import time
from pathlib import Path

import bpy

from .command import Request, bake_command, lamp_box, sun_arc
from .export import export_scene
from .job import Job, lost_in
from .results import apply_light_map

# Seconds between two looks at the process.
TICK = 0.25


def output_folder(context) -> Path:
    """Folder of the results: relative paths are those of the .blend file."""
    return Path(bpy.path.abspath(context.scene.lightwell.out))


def program(context) -> tuple[list[str], dict[str, str]]:
    """Words that start lightwell, and the variables of its process."""
    addon = context.preferences.addons.get(__package__)
    chosen = addon.preferences.program if addon else ""
    environment = dict(os.environ)
    if chosen:
        return [bpy.path.abspath(chosen), "-m", "lightwell"], environment
    # The wheels of this extension are on the path of this Python, which is not that of a new process.
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    return [sys.executable, "-m", "lightwell"], environment


def request_of(context, quality: str | None = None) -> Request:
    """What the panels ask for."""
    settings, out = context.scene.lightwell, output_folder(context)
    lamp, vary = settings.lamp, ()
    if settings.field != "lightmap" and lamp is not None:
        moves_far = lamp.data.type == "SUN"
        vary = (
            sun_arc(settings.sun_start, settings.sun_end)
            if moves_far
            else lamp_box(lamp.matrix_world.translation, settings.reach)
        )
    return Request(
        scene=out / "exported.glb",
        out=out / "baked",
        field=settings.field,
        quality=quality or settings.quality,
        budget=0.0 if quality else settings.budget,
        vary=vary,
        log=out / "process" / "progress.log",
    )


def show_status(context, text: str | None) -> None:
    """Show a text in Blender's status bar; None shows Blender's own again."""
    if context.workspace is not None:
        context.workspace.status_text_set(text)


class LIGHTWELL_OT_bake(bpy.types.Operator):
    """Bake the scene's indirect light in a process of its own; Esc ends it"""

    bl_idname = "lightwell.bake"
    bl_label = "Bake"

    quality: bpy.props.StringProperty(default="", options={"SKIP_SAVE", "HIDDEN"})
    # The running bake: one at a time.
    running = None

    @classmethod
    def poll(cls, _context) -> bool:
        """Whether a bake may start."""
        return cls.running is None

    def _start(self, context) -> Job:
        begin = time.monotonic()
        request = request_of(context, self.quality or None)
        export_scene(context, request.scene)
        self.report({"INFO"}, f"Exported in {time.monotonic() - begin:.1f} s")
        words, environment = program(context)
        return Job(bake_command(words, request), request.log.parent, environment)

    def invoke(self, context, _event):
        """Export, start the process and a timer."""
        try:
            job = self._start(context)
        except (ValueError, RuntimeError, OSError) as error:
            self.report({"ERROR"}, str(error).splitlines()[0])
            return {"CANCELLED"}
        LIGHTWELL_OT_bake.running = job
        self._timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Look at the process; everything else is Blender's."""
        job = LIGHTWELL_OT_bake.running
        if job is None:
            return {"CANCELLED"}
        if event.type == "ESC":
            job.cancel()
        if event.type != "TIMER":
            return {"RUNNING_MODAL"} if event.type == "ESC" else {"PASS_THROUGH"}
        code = job.poll()
        if code is None:
            show_status(context, f"Lightwell: {job.stage()}, {job.seconds:.0f} s (Esc ends it)")
            return {"PASS_THROUGH"}
        return self._end(context, code)

    def execute(self, context):
        """Bake and wait: for Blender without a window."""
        try:
            job = self._start(context)
        except (ValueError, RuntimeError, OSError) as error:
            self.report({"ERROR"}, str(error).splitlines()[0])
            return {"CANCELLED"}
        return self._result(context, job.wait(), job)

    def cancel(self, context) -> None:
        """Blender ends the operator: end the process too."""
        if LIGHTWELL_OT_bake.running is not None:
            LIGHTWELL_OT_bake.running.cancel()
            self._end(context, -1)

    def _end(self, context, code: int):
        job, LIGHTWELL_OT_bake.running = LIGHTWELL_OT_bake.running, None
        context.window_manager.event_timer_remove(self._timer)
        show_status(context, None)
        return self._result(context, code, job)

    def _result(self, context, code: int, job: Job):
        if code != 0:
            self.report({"WARNING"} if code < 0 else {"ERROR"}, "Cancelled" if code < 0 else job.message())
            return {"CANCELLED"}
        for line in lost_in(output_folder(context) / "baked" / "report.json")[:10]:
            self.report({"WARNING"}, line)
        self.report({"INFO"}, f"Baked in {job.seconds:.0f} s")
        return {"FINISHED"}


class LIGHTWELL_OT_cancel(bpy.types.Operator):
    """End the running bake"""

    bl_idname = "lightwell.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, _context) -> bool:
        """Whether a bake runs."""
        return LIGHTWELL_OT_bake.running is not None

    def execute(self, _context):
        """Ask the process to end; the timer sees it end."""
        LIGHTWELL_OT_bake.running.cancel()
        return {"FINISHED"}


class LIGHTWELL_OT_open(bpy.types.Operator):
    """Open the page of the last bake in a browser"""

    bl_idname = "lightwell.open_page"
    bl_label = "Open page"

    def execute(self, context):
        """Open it."""
        page = output_folder(context) / "baked" / "index.html"
        if not page.is_file():
            self.report({"ERROR"}, f"There is no page yet: {page}")
            return {"CANCELLED"}
        if not bpy.app.background:
            bpy.ops.wm.url_open(url=page.resolve().as_uri())
        return {"FINISHED"}


class LIGHTWELL_OT_apply(bpy.types.Operator):
    """Import the baked scene into a collection and put its light map on the materials"""

    bl_idname = "lightwell.apply"
    bl_label = "Apply as light maps"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Write the light map, import the scene, connect both."""
        words, environment = program(context)
        out = output_folder(context)
        command = [*words, "export", str(out / "baked"), "--to", "threejs", "-o", str(out / "applied")]
        try:
            job = Job(command, out / "process", environment)
            if job.wait() != 0:
                raise ValueError(job.message())
            count = apply_light_map(context, out / "applied")
        except (ValueError, RuntimeError, OSError) as error:
            self.report({"ERROR"}, str(error).splitlines()[0])
            return {"CANCELLED"}
        self.report({"INFO"}, f"{count} materials have the light map")
        return {"FINISHED"}


CLASSES = (LIGHTWELL_OT_bake, LIGHTWELL_OT_cancel, LIGHTWELL_OT_open, LIGHTWELL_OT_apply)
