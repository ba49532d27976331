"""The incremental bake of light probes: ``lightwell bake SCENE --rebake OLD --box x0,y0,z0,x1,y1,z1``.

Only what the box touches is cast, fitted, traced and solved again. The probes of OLD, baked with ``--keep``, say how;
nothing is trained, and nothing is measured against the truth: that is what a whole bake is for.
"""

from __future__ import annotations

import json
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.asset.records import FieldEntry
from lightwell.asset.write import write_glb
from lightwell.baking.progress import Progress
from lightwell.baking.work import check_output
from lightwell.fields.probes import PRESETS, fit_of, payload
from lightwell.fields.probes_baked import BakedProbes, Shown
from lightwell.files import make_folder, write_atomically
from lightwell.scenes import load
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, declare, to_json

ROLES = ("indirect", "static")


def parse_box(text: str) -> np.ndarray:
    """[2, 3] corners of 'x0,y0,z0,x1,y1,z1' in metres."""
    try:
        box = np.array([float(part) for part in text.split(",")])
    except ValueError:
        box = np.zeros(0)
    if box.shape != (6,) or not np.isfinite(box).all() or not (box[:3] <= box[3:]).all():
        raise ValueError(f"bake: --box '{text}' is no box; give x0,y0,z0,x1,y1,z1 in metres, smallest corner first")
    return box.reshape(2, 3)


def rebake(
    source: str, out: Path, old: Path, box: np.ndarray, vary: tuple[str, ...], progress: Progress, **options: Any
) -> dict[str, Any]:
    """Write ``scene.glb``, the probes, their page and ``rebake.json``; returns the content of the last.

    ``options`` are those of ``lightwell.scenes.load``.
    """
    kept = {role: BakedProbes.kept(path) for role in ROLES if (path := old / f"probes-{role}.npz").is_file()}
    if not kept:
        raise ValueError(f"bake: '{old}' holds no probes to start from; bake it with --field probes --keep first")
    scene = load(source, **options)
    check_output(out)
    make_folder(out)
    variable = declare(vary, scene)
    _check(scene, kept, old)
    roles, made = {}, {}
    for role, (before, shown) in kept.items():
        start = perf_counter()
        after, again = before.rebaked(scene, variable, box, fit_of(PRESETS[before.preset]))
        made[role] = after, shown
        roles[role] = {
            "probes": int(after.lit.geometry.volume.alive.sum()),
            "solved_again": len(again),
            "seconds": round(perf_counter() - start, 3),
        }
    size = _write(scene, variable, out, made, progress)
    told = {"from": str(old), "box": box.tolist(), "bytes": size, "roles": roles}
    write_atomically(out / "rebake.json", json.dumps(told, indent=1) + "\n")
    for role, facts in roles.items():
        progress.say(
            f"{role}: {facts['solved_again']} of {facts['probes']} probes solved again in {facts['seconds']:.2f} s"
        )
    return told


def _check(scene: Scene, kept: dict[str, tuple[BakedProbes, Shown]], old: Path) -> None:
    """The presets must be known, and the lattice must still hold the scene."""
    for before, _ in kept.values():
        if before.preset not in PRESETS:
            raise ValueError(f"bake: '{old}' has the unknown preset '{before.preset}'; bake the scene whole")
    lattice = next(iter(kept.values()))[0].lit.geometry.volume.lattice
    low, high = lattice.origin, lattice.origin + lattice.spacing * np.array(lattice.cells)
    if (scene.bounds[0] < low - 1e-4).any() or (scene.bounds[1] > high + 1e-4).any():
        raise ValueError(f"bake: the scene has outgrown the probes of '{old}'; bake it whole, without --rebake")


def _write(scene: Scene, variable: Variable, out: Path, made: dict[str, tuple], progress: Progress) -> int:
    """All files; returns the size of the asset."""
    entries = [
        FieldEntry(role, role, probes.lower(), 0 if role == "indirect" else None) for role, (probes, _) in made.items()
    ]
    shown = next(iter(made.values()))[1]
    strength = max(float(shown.intensity.max()), 1e-30)
    variables = [to_json(variable, shown.light, strength, tuple(shown.intensity / strength))]
    glb = out / "scene.glb"
    size = write_glb(glb, scene, entries, variables)
    for role, (probes, shown) in made.items():
        in_file = probes.write_files(out, role, glb.read_bytes(), scene, shown)
        probes.keep(out, role, shown)
        progress.say(f"{role}: {payload(probes.lit.geometry.volume, probes.coding, in_file)}")
    return size
