"""How good learned light looks: pictures with the reference's noise taken off, blotches, leaks; for 1 cd (1 lx).

Truth is traced once and scored against any number of fields. Notation: V views of H x W pixels, N points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from lightwell.baking.reference import PointReference, ViewReference, trace_points, trace_view
from lightwell.baking.reference_budget import EVALUATION_SEED, ReferenceBudget
from lightwell.report import metrics
from lightwell.report.metrics import Mottle
from lightwell.scenes.placing import held_out_lights
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable
from lightwell.transport import direct, indirect
from lightwell.transport.patches import POINTS, draw_patches
from lightwell.transport.samples import SurfacePoints

Learned = Callable[[SurfacePoints, np.ndarray], np.ndarray]
"""(N surface points, lights [3] or [N, 3]) → [N, 3] radiance of a learned field for a unit light, reflectance included:
``lightwell.baking.evaluate.Shipped.at``."""

# Patches that are scored, candidates per patch among which lit ones are sought, and the paths of that search.
PATCHES, PATCH_CANDIDATES, PATCH_PILOT_PATHS = 240, 4, 32
# A direct light without size needs no more.
DIRECT_PATHS = 2


@dataclass(frozen=True)
class PatchTruth:
    """Flat patches of ``POINTS`` points each under one light each, patch by patch."""

    points: SurfacePoints
    light: np.ndarray
    """[N, 3]."""
    half_a: np.ndarray
    """[N, 3] radiance, mean over the first half of the paths."""
    half_b: np.ndarray


@dataclass(frozen=True)
class PictureTruth:
    """A view with what does not have to be learned."""

    view: ViewReference
    direct: np.ndarray
    """[N, 3] direct radiance of the declared light at the points of the view."""
    size: tuple[int, int]
    """Width and height."""


@dataclass(frozen=True)
class QualityTruth:
    """All that one scene is judged by."""

    pictures: Sequence[PictureTruth]
    patches: PatchTruth | None
    points: PointReference


@dataclass(frozen=True)
class Quality:
    """Figures of one field on one scene; None: the scene has nothing to measure it by."""

    psnr_db: float | None
    """Displayed indirect light, noise of the reference taken off, mean over views."""
    flip: float | None
    """Of whole pictures, direct light included, against the reference."""
    flip_direct: float | None
    """... of direct light alone: what a picture without learned light scores."""
    mottle: float | None
    """Blotches on lit patches whose truth is smooth."""
    mottle_lit: float | None
    """... on all lit patches."""
    leak: float
    relative_error: float
    noise_floor: float
    """Relative error that the reference itself has."""
    per_view: Sequence[float | None]
    """PSNR of each view."""

    def json(self) -> dict:
        """Plain values."""
        return asdict(self)


# ---------------------------------------------------------------------- truth


def trace_quality(
    scene: Scene,
    variable: Variable,
    views: Sequence[tuple[Camera, np.ndarray]],
    size: tuple[int, int],
    budget: ReferenceBudget,
    seed: int,
) -> QualityTruth:
    """Trace the truth of the declared light at views, patches and area-uniform points."""
    pictures = [trace_picture(scene, variable, camera, light, size, budget.pixel_paths) for camera, light in views]
    points = trace_points(scene, variable, "indirect", budget, seed)
    return QualityTruth(pictures, trace_patches(scene, variable, PATCHES, budget.point_paths, seed), points)


def trace_picture(
    scene: Scene, variable: Variable, camera: Camera, light: np.ndarray, size: tuple[int, int], paths: int
) -> PictureTruth:
    """Indirect and direct light of one view at its pixel centres."""
    view = trace_view(scene, variable, camera, light, ["indirect"], size, paths)
    return PictureTruth(view, direct(scene, view.points, light, variable, DIRECT_PATHS), size)


def trace_patches(scene: Scene, variable: Variable, count: int, paths: int, seed: int) -> PatchTruth | None:
    """Truth of the most lit patches among candidates with random held-out lights; None without flat surface."""
    candidates = draw_patches(scene, PATCH_CANDIDATES * count, seed + EVALUATION_SEED)
    number = len(candidates) // POINTS
    if not number:
        return None
    lights = held_out_lights(scene, variable, 32, seed + 4 * EVALUATION_SEED)
    light = lights[np.arange(number) % len(lights)].repeat(POINTS, axis=0)
    pilot = _first_of_patches(number)
    a, b = indirect(scene, candidates[pilot], light[pilot], variable, PATCH_PILOT_PATHS, seed)
    chosen = _spread_of_lit((a + b).mean(axis=-1), count)
    rows = (chosen[:, None] * POINTS + np.arange(POINTS)).ravel()
    points: SurfacePoints = candidates[rows]
    a, b = indirect(scene, points, light[rows], variable, paths, seed + EVALUATION_SEED)
    return PatchTruth(points, light[rows], a, b)


def _first_of_patches(number: int) -> np.ndarray:
    """Rows of the middle points of ``number`` patches."""
    return np.arange(number) * POINTS


def _spread_of_lit(value: np.ndarray, count: int) -> np.ndarray:
    """Indices of patches, the lit ones first (mean above the shares of ``metrics.mottle``), in their random order."""
    bright = np.percentile(value, metrics.BRIGHT_PERCENTILE)
    return np.sort(np.argsort(value <= metrics.LIT_SHARE * bright, kind="stable")[:count])


# ---------------------------------------------------------------------- scores


def score_quality(truth: QualityTruth, learned: Learned) -> Quality:
    """Every figure of a field; ``learned`` is evaluated once per record."""
    per_view, flips, bare = [], [], []
    for picture in truth.pictures:
        psnr, whole, alone = score_picture(picture, learned(picture.view.points, picture.view.light))
        per_view.append(psnr)
        flips.append(whole)
        bare.append(alone)
    blotches = _mottle(truth.patches, learned)
    points = truth.points
    f, y = learned(points.points, points.light), 0.5 * (points.half_a + points.half_b)
    unit = metrics.unit(y, points.weight)
    return Quality(
        psnr_db=_mean(per_view),
        flip=_mean(flips),
        flip_direct=_mean(bare),
        mottle=blotches.smooth,
        mottle_lit=blotches.lit,
        leak=metrics.leak(f, points.half_a, points.half_b, points.weight),
        relative_error=metrics.relative_error(f / unit, y / unit, points.weight).mean,
        noise_floor=metrics.noise_floor(points.half_a / unit, points.half_b / unit, points.weight).mean,
        per_view=per_view,
    )


def score_picture(picture: PictureTruth, f: np.ndarray) -> tuple[float | None, float | None, float | None]:
    """(PSNR of indirect light, FLIP of the whole, FLIP of direct light alone) of radiance [N, 3] at the view's points.

    Exposed by the reference, picture by picture. None where the reference is black.
    """
    view = picture.view
    y = 0.5 * (view.half_a + view.half_b)
    of_indirect, of_whole = metrics.exposure_unit(y) if len(y) else None, None
    if of_indirect is None:
        return None, None, None
    image = lambda x: place(picture, x)  # noqa: E731
    psnr = metrics.psnr_noise_free_db(*(image(x / of_indirect) for x in (f, view.half_a, view.half_b)))
    of_whole = metrics.exposure_unit(picture.direct + y)
    reference = image((picture.direct + y) / of_whole)
    whole, alone = (metrics.flip(image((picture.direct + x) / of_whole), reference) for x in (f, np.zeros_like(f)))
    return psnr, whole, alone


def place(picture: PictureTruth, values: np.ndarray) -> np.ndarray:
    """[H, W, 3] picture of values [N, 3] at the points of a view, black elsewhere."""
    width, height = picture.size
    full = np.zeros((height * width, 3), np.float64)
    full[picture.view.seen] = values
    return full.reshape(height, width, 3)


def _mottle(patches: PatchTruth | None, learned: Learned) -> Mottle:
    if patches is None:
        return Mottle(None, None, 0)
    f, a, b = (
        x.reshape(-1, POINTS, 3) for x in (learned(patches.points, patches.light), patches.half_a, patches.half_b)
    )
    return metrics.mottle(f, a, b)


def _mean(values: Sequence[float | None]) -> float | None:
    found = [v for v in values if v is not None]
    return float(np.mean(found)) if found else None
