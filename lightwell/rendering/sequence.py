"""Sequences along an orbit of the camera with the radiance cache; they resume where they were interrupted."""

from __future__ import annotations

import json
import logging
import math
import time
from pathlib import Path
from typing import Any

from lightwell.backend import dr
from lightwell.cache import checkpoint
from lightwell.cache.integrator import NrcIntegrator
from lightwell.cache.settings import CacheSettings
from lightwell.core.color import automatic_exposure
from lightwell.core.image_io import write_picture
from lightwell.core.output import FRAME_FILES, output_folder
from lightwell.core.progress import Progress
from lightwell.files import write_atomically
from lightwell.rendering.nrc import Film
from lightwell.rendering.settings import NrcOptions, RenderSettings

# The cache of a sequence, stored beside its pictures, so that a resumed sequence continues with the trained cache.
CACHE_NAME, PLAN_NAME, EXPOSURE_NAME = "radiance-cache.npz", "animation.json", "exposure.txt"
# A sequence turns the camera once around its target.
DEGREES = 360.0
LOG = logging.getLogger("lightwell.cache")


def render_sequence(
    settings: RenderSettings, cache: CacheSettings, degrees: float = DEGREES, progress: Progress | None = None
) -> dict[str, Any]:
    """Render an orbit of the camera into a folder; with ``resume``, existing frames are kept.

    Args:
        settings: Settings of the sequence.
        cache: Settings of the radiance cache.
        degrees: Angle of the orbit.
        progress: Display of the finished frames; None: nothing is shown.

    Returns:
        Facts about the sequence; JSON values.

    Raises:
        ValueError: The cache asks for stills, or the folder holds another sequence that is to be resumed.
    """
    if cache.image.mode == "still":
        raise ValueError("render: --nrc mode=still is for single pictures; leave it out, or --frames")
    options: NrcOptions = settings.options
    folder, frames, kind = Path(settings.out), options.frames or 1, options.format or "exr"
    with output_folder(folder, "render", FRAME_FILES, options.force):
        film = Film(settings)
        again = _is_begun(folder, _plan(settings, cache, degrees, film.shot.scene.digest), options.resume)
        integrator = NrcIntegrator(settings=cache.changed(mode="frames"))
        step = math.radians(degrees) / frames
        done, exposure = _resumed(folder, integrator, film, step, kind) if again else (0, film.exposure)
        start = time.perf_counter()
        with (progress or Progress(quiet=True)).stage("frames", frames) as stage:
            for k in range(done, frames):
                stage.move_to(k)
                picture = film.render(integrator, settings.seed + k)
                if exposure is None:
                    exposure = automatic_exposure(picture)
                    write_atomically(folder / EXPOSURE_NAME, repr(exposure))
                write_picture(folder / f"frame-{k:04d}.{kind}", picture, exposure)
                checkpoint.save(folder / CACHE_NAME, integrator, checkpoint.Progress(k + 1, exposure))
                film.turn(step)
            stage.move_to(frames)
        dr.sync_thread()
    return {"frames": frames, "rendered": frames - done, "seconds": time.perf_counter() - start, "folder": str(folder)}


def _plan(settings: RenderSettings, cache: CacheSettings, degrees: float, digest: str) -> dict[str, Any]:
    """Settings that determine the frames of a sequence; a sequence with other settings is not resumed."""
    plan = {
        "scene": str(settings.scene),
        "digest": digest,
        "size": list(settings.size),
        "spp": settings.spp,
        "frames": settings.options.frames,
        "degrees": degrees,
        "seed": settings.seed,
        "settings": cache.to_json(),
    }
    placed: dict[str, Any] = {"camera": settings.camera, "light": settings.light, "intensity": settings.intensity}
    # Limits say what may be read, not what is seen.
    placed["unit"] = settings.unit if settings.unit != 1 else None
    placed["allow_paths"] = [str(path) for path in settings.allow_paths]
    placed["format"] = settings.options.format
    return plan | {name: value for name, value in placed.items() if value}


def _is_begun(folder: Path, plan: dict[str, Any], resume: bool) -> bool:
    """Test whether the folder holds this sequence and is to be resumed; otherwise write a new plan."""
    path = folder / PLAN_NAME
    if resume and path.exists():
        try:
            before = json.loads(path.read_text())
        except ValueError:
            before = None
        if before != json.loads(json.dumps(plan)):
            raise ValueError(f"render: '{folder}' holds another animation; choose another folder or drop --resume")
        return True
    # The checkpoint of another sequence must not be used for this one.
    (folder / CACHE_NAME).unlink(missing_ok=True)
    write_atomically(path, json.dumps(plan, indent=1) + "\n")
    return False


def _resumed(
    folder: Path, integrator: NrcIntegrator, film: Film, step: float, kind: str
) -> tuple[int, float | None]:  # fmt: skip
    """Frames that need not be rendered again, and the exposure. Without a sound checkpoint, with all of its pictures,
    that is none, because every frame depends on the training in the frames before it."""
    path = folder / CACHE_NAME
    if not path.exists():
        return 0, film.exposure
    try:
        found = checkpoint.load(path, integrator, film.live.scene)
    except ValueError as error:
        LOG.warning("render: the sequence begins anew: %s", error)
        return 0, film.exposure
    missing = [k for k in range(found.frames) if not (folder / f"frame-{k:04d}.{kind}").exists()]
    if missing:
        LOG.warning("render: the sequence begins anew: frame-%04d.%s is missing", missing[0], kind)
        integrator.cache, integrator.reservoirs.held = None, None
        integrator.temporal.forget()
        return 0, film.exposure
    for k in range(found.frames):
        if k == found.frames - 1:
            integrator.reservoirs.saw(film.sensor)
        film.turn(step)
    return found.frames, found.exposure
