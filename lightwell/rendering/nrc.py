"""Pictures, and sequences along an orbit of the camera, with the radiance cache; progress and resume."""

from __future__ import annotations

import json
import logging
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache import checkpoint
from lightwell.cache.integrator import NrcIntegrator
from lightwell.cache.live import Lamp, LiveScene
from lightwell.cache.settings import CacheSettings, parse_options
from lightwell.core.color import automatic_exposure
from lightwell.core.image_io import check_picture_name, write_picture
from lightwell.core.output import FRAME_FILES, output_folder
from lightwell.files import write_atomically
from lightwell.rendering.path import Shot
from lightwell.rendering.settings import NrcOptions, RenderSettings

# The cache of a sequence, stored beside its pictures, so that a resumed sequence continues with the trained cache.
CACHE_NAME, PLAN_NAME, EXPOSURE_NAME = "radiance-cache.npz", "animation.json", "exposure.txt"
# A sequence turns the camera once around its target.
DEGREES = 360.0
LOG = logging.getLogger("lightwell.cache")


class Film:
    """A scene, a film of the requested size, and a camera that can turn around its target."""

    def __init__(self, settings: RenderSettings) -> None:
        """Load the scene.

        Args:
            settings: Settings of the picture.
        """
        shot = Shot.of(settings)
        width, height = settings.size
        lamp = None
        if shot.light is not None or shot.intensity is not None:
            lamp = Lamp(shot.good_light, 1.0 if shot.intensity is None else shot.intensity)
        # A scene without cameras is viewed from outside of its bounds.
        camera = shot.camera if shot.scene.cameras else None
        self.live = LiveScene(shot.scene, 16, camera, lamp)
        self.spp = settings.spp
        self.exposure = None if shot.intensity is None else 1.0
        """Of pictures for screens; None: automatic."""
        self.sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": self.live.fov,
                "fov_axis": "y",
                "to_world": self.live._pose(),
                "sampler": {"type": "independent", "sample_count": settings.spp},
                "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
            }
        )

    def turn(self, radians: float) -> None:
        """Turn the camera around its target.

        Args:
            radians: Angle about the vertical axis.
        """
        self.live.orbit(radians, 0, 0)
        parameters = mi.traverse(self.sensor)
        parameters["to_world"] = mi.Transform4f(self.live._pose().matrix)
        parameters.update()

    def render(self, integrator: Any, seed: int) -> np.ndarray:
        """Render the picture.

        Args:
            integrator: Mitsuba integrator.
            seed: Seed of the sampler.

        Returns:
            [H, W, 3] float32 linear radiance.
        """
        image = mi.render(self.live.scene, sensor=self.sensor, integrator=integrator, spp=self.spp, seed=seed)
        return np.array(image)[..., :3]


def render_nrc(settings: RenderSettings, quiet: bool = True) -> dict[str, Any]:
    """Render one picture with the radiance cache or, with ``frames``, a sequence.

    Args:
        settings: Settings of the picture.
        quiet: Whether no progress is shown.

    Returns:
        Facts about the picture or sequence; JSON values.
    """
    cache = parse_options(settings.options.nrc)
    return render_sequence(settings, cache, quiet=quiet) if settings.options.frames else _still(settings, cache)


def _still(settings: RenderSettings, cache: CacheSettings) -> dict[str, Any]:
    check_picture_name(settings.out, "render")
    film = Film(settings)
    integrator = NrcIntegrator(settings=cache)
    start = time.perf_counter()
    picture = film.render(integrator, settings.seed)
    seconds = time.perf_counter() - start
    write_picture(Path(settings.out), picture, film.exposure)
    stats = [t for t in integrator.stats if t.steps]
    width, height = settings.size
    return {
        "scene": film.live.name, "width": width, "height": height, "spp": settings.spp, "integrator": "lightwell_nrc",
        "seconds": seconds, "training_seconds": integrator.seconds["train"],
        "training_steps": sum(t.steps for t in stats), "records_dropped": sum(t.dropped for t in integrator.stats),
        "termination_c": cache.termination_c, "termination_sdk_t": math.sqrt(cache.termination_c) / (4 * math.pi),
        "loss": stats[-1].loss if stats else None, "bias": list(stats[-1].bias) if stats else None,
        "mean_radiance": float(picture.mean()),
    }  # fmt: skip


def render_sequence(
    settings: RenderSettings, cache: CacheSettings, degrees: float = DEGREES, quiet: bool = True
) -> dict[str, Any]:
    """Render an orbit of the camera into a folder; with ``resume``, existing frames are kept.

    Args:
        settings: Settings of the sequence.
        cache: Settings of the radiance cache.
        degrees: Angle of the orbit.
        quiet: Whether no progress is shown.

    Returns:
        Facts about the sequence; JSON values.
    """
    options: NrcOptions = settings.options
    folder, frames, kind, seed = Path(settings.out), options.frames, options.format or "exr", settings.seed
    with output_folder(folder, "render", FRAME_FILES, options.force):
        again = _is_begun(folder, _plan(settings, cache, degrees), options.resume)
        film = Film(settings)
        integrator = NrcIntegrator(settings=cache.changed(mode="frames"))
        step = math.radians(degrees) / frames
        done, exposure = _resumed(folder, integrator, film, step, kind) if again else (0, film.exposure)
        start = time.perf_counter()
        for k in range(done, frames):
            picture = film.render(integrator, seed + k)
            if exposure is None:
                exposure = automatic_exposure(picture)
                write_atomically(folder / EXPOSURE_NAME, repr(exposure))
            write_picture(folder / f"frame-{k:04d}.{kind}", picture, exposure)
            checkpoint.save(folder / CACHE_NAME, integrator, checkpoint.Progress(k + 1, exposure))
            if not quiet:
                print(f"\rframe {k + 1}/{frames}, {time.perf_counter() - start:.0f} s", end="", file=sys.stderr)
            film.turn(step)
        if not quiet:
            print(file=sys.stderr)
        dr.sync_thread()
    return {"frames": frames, "rendered": frames - done, "seconds": time.perf_counter() - start, "folder": str(folder)}


def _plan(settings: RenderSettings, cache: CacheSettings, degrees: float) -> dict[str, Any]:
    """Settings that determine the frames of a sequence; a sequence with other settings is not resumed."""
    plan = {
        "scene": str(settings.scene),
        "size": list(settings.size),
        "spp": settings.spp,
        "frames": settings.options.frames,
        "degrees": degrees,
        "seed": settings.seed,
        "settings": cache.to_json(),
    }
    placed = {"camera": settings.camera, "light": settings.light, "intensity": settings.intensity}
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
        return 0, None
    try:
        found = checkpoint.load(path, integrator, film.live.scene)
    except ValueError as error:
        LOG.warning("render: the sequence begins anew: %s", error)
        return 0, None
    missing = [k for k in range(found.frames) if not (folder / f"frame-{k:04d}.{kind}").exists()]
    if missing:
        LOG.warning("render: the sequence begins anew: frame-%04d.%s is missing", missing[0], kind)
        integrator.cache = integrator.reservoirs = None
        return 0, None
    for k in range(found.frames):
        if k == found.frames - 1:
            integrator.saw(film.sensor)
        film.turn(step)
    return found.frames, found.exposure
