"""`lightwell render --integrator nrc`: a still, or a sequence along an orbit, with progress and resume."""

from __future__ import annotations

import io
import json
import logging
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lightwell.backend import dr, mi
from lightwell.cache import checkpoint
from lightwell.cache.integrator import NrcIntegrator
from lightwell.cache.live import LiveScene
from lightwell.cache.settings import CacheSettings
from lightwell.core.output import FRAME_FILES, output_folder
from lightwell.files import write_atomically
from lightwell.scenes.mitsuba_textures import linear_to_srgb8

# The cache of a sequence, kept beside its pictures so that a resumed one goes on with what was learned.
CACHE_NAME, PLAN_NAME, EXPOSURE_NAME = "radiance-cache.npz", "animation.json", "exposure.txt"
MIDDLE_GREY = 0.18
LOG = logging.getLogger("lightwell.cache")


def write_picture(path: Path, picture: np.ndarray, exposure: float | None = None) -> None:
    """[H, W, 3] linear as .exr, or exposed and tone-mapped as .png; whole or not at all."""
    if path.suffix.lower() == ".exr":
        stream = mi.MemoryStream()
        mi.Bitmap(np.ascontiguousarray(picture[..., :3], np.float32)).write(stream, mi.Bitmap.FileFormat.OpenEXR)
        stream.seek(0)
        data = stream.read(stream.size())
    else:
        x = picture[..., :3] * (automatic_exposure(picture) if exposure is None else exposure)
        buffer = io.BytesIO()
        Image.fromarray(linear_to_srgb8(np.nan_to_num(x * (1 + x / 16) / (1 + x)))).save(buffer, "PNG")
        data = buffer.getvalue()
    write_atomically(path, data)


def automatic_exposure(picture: np.ndarray) -> float:
    """The factor that brings the logarithmic mean to middle grey."""
    lit = picture[..., :3].mean(axis=-1)
    lit = lit[lit > 1e-6]
    return float(MIDDLE_GREY / np.exp(np.log(lit).mean())) if len(lit) else 1.0


class Shot:
    """A scene, a film of the asked size, and a camera that can turn round its target."""

    def __init__(self, source: str, width: int, height: int, spp: int, **options: Any) -> None:
        """``options`` are those of ``lightwell.scenes.load``."""
        self.live = LiveScene(source, 16, **options)
        self.spp = spp
        self.sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": self.live.fov,
                "fov_axis": "y",
                "to_world": self.live._pose(),
                "sampler": {"type": "independent", "sample_count": spp},
                "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
            }
        )

    def turn(self, radians: float) -> None:
        """Turn the camera round its target."""
        self.live.orbit(radians, 0, 0)
        parameters = mi.traverse(self.sensor)
        parameters["to_world"] = mi.Transform4f(self.live._pose().matrix)
        parameters.update()

    def render(self, integrator: Any, seed: int) -> np.ndarray:
        """The picture [H, W, 3]."""
        image = mi.render(self.live.scene, sensor=self.sensor, integrator=integrator, spp=self.spp, seed=seed)
        return np.array(image)[..., :3]


def render_nrc(
    source: str, out: Path, settings: CacheSettings, width: int, height: int, spp: int, seed: int = 0, **options: Any
) -> dict[str, Any]:
    """One picture with the radiance cache; returns facts about it.

    ``options`` are those of ``lightwell.scenes.load``.
    """
    _check_suffix(out)
    shot = Shot(source, width, height, spp, **options)
    integrator = NrcIntegrator(settings=settings)
    start = time.perf_counter()
    picture = shot.render(integrator, seed)
    seconds = time.perf_counter() - start
    write_picture(out, picture)
    told = [t for t in integrator.told if t.steps]
    return {
        "scene": shot.live.name, "width": width, "height": height, "spp": spp, "integrator": "lightwell_nrc",
        "seconds": seconds, "training_seconds": integrator.seconds["train"],
        "training_steps": sum(t.steps for t in told), "records_dropped": sum(t.dropped for t in integrator.told),
        "termination_c": settings.termination_c, "termination_sdk_t": math.sqrt(settings.termination_c) / (4 * math.pi),
        "loss": told[-1].loss if told else None, "bias": list(told[-1].bias) if told else None,
        "mean_radiance": float(picture.mean()),
    }  # fmt: skip


def _check_suffix(out: Path) -> None:
    if out.suffix.lower() not in (".png", ".exr"):
        raise ValueError(f"render: '{out}' is neither .png nor .exr; choose one of them")


def render_animation(
    source: str, folder: Path, settings: CacheSettings, width: int, height: int, spp: int, frames: int,
    degrees: float = 360.0, seed: int = 0, kind: str = "exr", resume: bool = False, quiet: bool = False,
    force: bool = False, **options: Any,
) -> dict[str, Any]:  # fmt: skip
    """An orbit of ``degrees`` in ``frames`` pictures; what stands there already is kept with ``resume``.

    ``options`` are those of ``lightwell.scenes.load``.
    """
    if kind not in ("exr", "png"):
        raise ValueError(f"render: '{kind}' is no picture format; choose exr or png")
    plan = {"scene": str(source), "size": [width, height], "spp": spp, "frames": frames, "degrees": degrees,
            "seed": seed, "settings": settings.to_json()}  # fmt: skip
    with output_folder(folder, "render", FRAME_FILES, force):
        again = _is_begun(folder, plan, resume)
        shot = Shot(source, width, height, spp, **options)
        integrator = NrcIntegrator(settings=settings.changed(mode="frames"))
        step = math.radians(degrees) / frames
        done, exposure = _resumed(folder, integrator, shot, step, kind) if again else (0, None)
        start = time.perf_counter()
        for k in range(done, frames):
            picture = shot.render(integrator, seed + k)
            if exposure is None:
                exposure = automatic_exposure(picture)
                write_atomically(folder / EXPOSURE_NAME, repr(exposure))
            write_picture(folder / f"frame-{k:04d}.{kind}", picture, exposure)
            checkpoint.save(folder / CACHE_NAME, integrator, checkpoint.Progress(k + 1, exposure))
            if not quiet:
                print(f"\rframe {k + 1}/{frames}, {time.perf_counter() - start:.0f} s", end="", file=sys.stderr)
            shot.turn(step)
        if not quiet:
            print(file=sys.stderr)
        dr.sync_thread()
    return {"frames": frames, "rendered": frames - done, "seconds": time.perf_counter() - start, "folder": str(folder)}


def _is_begun(folder: Path, plan: dict[str, Any], resume: bool) -> bool:
    """Whether the folder holds this animation and is to be resumed; else its plan is written anew."""
    path = folder / PLAN_NAME
    if resume and path.exists():
        try:
            before = json.loads(path.read_text())
        except ValueError:
            before = None
        if before != json.loads(json.dumps(plan)):
            raise ValueError(f"render: '{folder}' holds another animation; choose another folder or drop --resume")
        return True
    # The checkpoint of another animation must not be taken for one of this.
    (folder / CACHE_NAME).unlink(missing_ok=True)
    write_atomically(path, json.dumps(plan, indent=1) + "\n")
    return False


def _resumed(
    folder: Path, integrator: NrcIntegrator, shot: Shot, step: float, kind: str
) -> tuple[int, float | None]:  # fmt: skip
    """Frames that need not be rendered again, and the exposure. Without a sound checkpoint, with all of its pictures,
    that is none: every frame depends on what the frames before it have learned."""
    path = folder / CACHE_NAME
    if not path.exists():
        return 0, None
    try:
        found = checkpoint.load(path, integrator, shot.live.scene)
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
            integrator.saw(shot.sensor)
        shot.turn(step)
    return found.frames, found.exposure
