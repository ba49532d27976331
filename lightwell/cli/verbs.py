"""The verbs of the command line."""

from __future__ import annotations

# Verb → what it does. Each is a module of this package of the same name with ``add(parser, argv)`` and
# ``run(arguments)``, which returns the exit code; DESCRIPTION, if it has one, is part of its help.
VERBS = {
    "bake": "learn the indirect light of a scene; write scene.glb, index.html, report.html and report.json",
    "batch": "bake many scenes, each with settings of its own, into one report; goes on where it was interrupted",
    "demo": "run the main job on a built-in scene and open the page",
    "view": "serve a baked folder on this machine and open the page",
    "render": "path-trace a picture of a scene (the reference that bakes are measured against)",
    "live": "a page in which the radiance cache learns while you move camera and lights",
    "lens": "blur a rendered frame: depth of field and motion blur in one pass",
    "compare": "train several fields on the same samples and compare them, or show the reports of several bakes",
    "samples": "path-trace samples of a scene's indirect light into a file, for work of your own",
    "info": "say what a baked asset or a scene holds",
    "export": "print a learned field as one self-contained shader text",
    "validate": "check a .glb against the specification of its learned light",
    "store": "say what lightwell keeps between runs, or remove it",
    "doctor": "say which backend runs here, and what to do when one does not",
    "completion": "print a script that completes verbs and options in a shell",
    "man": "print the manual page",
}
# The same in the groups in which help shows them.
GROUPS = {
    "make and look": ("demo", "bake", "batch", "view", "compare"),
    "pictures": ("render", "live", "lens"),
    "files": ("info", "export", "validate", "samples"),
    "this machine": ("doctor", "store", "completion", "man"),
}
# Verbs that compute: they take --threads, --memory and --log.
COMPUTING = ("bake", "batch", "demo", "render", "live", "lens", "compare", "samples", "info")
# Verbs that can be resumed after an interrupt, and verbs that run until they are interrupted.
RESUMABLE, SERVERS = ("bake", "batch", "demo"), ("view", "live")
# How a verb is gone on with after an interrupt.
GO_ON = {"batch": "the same command"}
