"""Quality of learned light: noise-corrected errors of pictures, mottle and light leaks; for 1 cd (1 lx).

The reference is traced once and any number of fields is scored against it. Notation: V views of H x W pixels, N points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from lightwell.baking.display_pictures import denoised
from lightwell.baking.late_notes import LateNotes
from lightwell.baking.poses import standing, view_pose
from lightwell.baking.reference import PointReference, Reference, ViewReference, trace_points, trace_view
from lightwell.baking.reference_budget import EVALUATION_SEED, ReferenceBudget
from lightwell.report import metrics, picture_metrics
from lightwell.report.mottle import BRIGHT_PERCENTILE, LIT_SHARE, NOTHING, Mottle, mottle
from lightwell.report.picture_metrics import NoiseFreePsnr
from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.placing import held_out_lights
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable, from_json, to_json
from lightwell.transport import direct, indirect, static
from lightwell.transport.camera import camera_points
from lightwell.transport.moved import at_pose
from lightwell.transport.patches import POINTS, draw_patches
from lightwell.transport.samples import SurfacePoints, columns_of

Learned = Callable[[SurfacePoints, np.ndarray], np.ndarray]
"""(N surface points, lights [3] or [N, 3]) → [N, 3] radiance of a learned field for a unit light, reflectance included:
``lightwell.baking.evaluate.Shipped.at``."""

# Patches that are scored, candidates per patch of the search for lit ones, and the paths of that search.
PATCHES, PATCH_CANDIDATES, PATCH_PILOT_PATHS = 240, 4, 32
# Held-out lights that the patches share.
PATCH_LIGHTS = 32
# Paths per point of direct light; a light without size needs no more.
DIRECT_PATHS = 2
# A view is exposed by its own light, but at most so many stops brighter than all views together, as an automatic
# exposure is limited: one into a closed cupboard, 17 stops darker, would be a picture of nothing but noise.
MOST_STOPS = 4


@dataclass(frozen=True)
class PatchReference:
    """Reference on flat patches of ``POINTS`` points each, with one light per patch; ordered by patch."""

    points: SurfacePoints
    light: np.ndarray
    """[N, 3]."""
    half_a: np.ndarray
    """[N, 3] radiance, mean over the first half of the paths."""
    half_b: np.ndarray


@dataclass(frozen=True)
class PictureReference:
    """Reference of a view, with the direct light, which is not learned."""

    view: ViewReference
    direct: np.ndarray
    """[N, 3] direct radiance of the declared light at the points of the view."""
    clean: np.ndarray
    """[N, 3] indirect radiance of the reference, denoised where a denoiser is installed."""
    size: tuple[int, int]
    """Width and height."""


@dataclass(frozen=True)
class QualityReference:
    """The complete reference of a scene."""

    pictures: Sequence[PictureReference]
    patches: PatchReference | None
    points: PointReference


@dataclass(frozen=True)
class Quality:
    """Figures of one field on one scene; None where the scene has nothing to measure."""

    psnr_db: float | None
    """PSNR of the indirect light in display values, corrected for the noise of the reference; mean over views. A lower
    bound where ``bounds`` has it."""
    flip: float | None
    """FLIP of whole pictures, direct light included, against the denoised reference."""
    flip_direct: float | None
    """... of direct light alone, the value of a picture without learned light."""
    mottle: float | None
    """Mottle on lit patches where the reference is smooth; None also where the noise of the reference hides it."""
    mottle_lit: float | None
    """... on all lit patches."""
    leak: float
    """Wrong light in the darkest quarter of the surface, over the mean; below its noise where ``bounds`` has it."""
    relative_error: float
    noise_floor: float
    """Relative error of the reference itself."""
    per_view: Sequence[float | None]
    """PSNR of each view."""
    bounds: dict[str, float]
    """Figures that the noise of the reference hides: the largest mottle and leak and the least PSNR that are
    possible."""

    def json(self) -> dict:
        """Convert the figures to JSON values.

        Returns:
            Figures by name.
        """
        return asdict(self)


# ---------------------------------------------------------------------- reference


def trace_quality(
    scene: Scene,
    variable: Variable,
    views: Sequence[tuple[Camera, np.ndarray]],
    size: tuple[int, int],
    budget: ReferenceBudget,
    seed: int,
) -> QualityReference:
    """Trace the reference of the declared light at views, patches and area-uniform points.

    Args:
        scene: The scene.
        variable: Ranges of the light.
        views: Camera and light [3] of each view.
        size: Width and height of the views, pixels.
        budget: Numbers of points, lights and paths.
        seed: Seed of the bake.

    Returns:
        The reference.
    """
    pictures = [trace_picture(scene, variable, camera, light, size, budget.pixel_paths) for camera, light in views]
    points = trace_points(scene, variable, "indirect", budget, seed)
    return QualityReference(pictures, trace_patches(scene, variable, PATCHES, budget.point_paths, seed), points)


def trace_picture(
    scene: Scene, variable: Variable, camera: Camera, light: np.ndarray, size: tuple[int, int], paths: int
) -> PictureReference:
    """Trace indirect and direct light of one view at its pixel centres.

    Args:
        scene: The scene.
        variable: Ranges of the light.
        camera: The camera.
        light: [3] position of the light in metres, or direction towards the sun.
        size: Width and height, pixels.
        paths: Paths per pixel, even, ≥ 2.

    Returns:
        The reference of the view.
    """
    view = trace_view(scene, variable, camera, light, ["indirect"], size, paths)
    bare = direct(scene, view.points, light, variable, DIRECT_PATHS, recipe=camera_points(camera, size, light))
    return PictureReference(view, bare, denoised(scene, view, size), size)


def quality_of_reference(
    scene: Scene,
    variable: Variable | None,
    reference: Reference,
    size: tuple[int, int],
    budget: ReferenceBudget,
    seed: int,
    notes: LateNotes,
) -> QualityReference | None:
    """Add what the figures of quality need to a reference: direct light of its views, and smooth patches.

    Args:
        scene: What is lit.
        variable: The light that moves; None: none does.
        reference: Traced views and points.
        size: Width and height of the views, pixels.
        budget: Counts of paths.
        seed: Seed of the bake.
        notes: Takes a note where a part fails.

    Returns:
        The reference of the figures; None where no point was traced.
    """
    if not reference.points:
        return None
    pictures = []
    for k, view in enumerate(reference.views):
        if view is None:
            continue
        bare = np.zeros_like(view.half_a)
        if variable is not None and len(view.points):
            bare = direct(scene, view.points, view.light, variable, DIRECT_PATHS)
            for other, place, weight in reference.stage.further(k):
                bare = bare + weight * direct(scene, view.points, place, other, DIRECT_PATHS)
        pictures.append(PictureReference(view, bare, denoised(scene, view, size), size))
    make = partial(trace_patches, scene, variable, PATCHES, budget.point_paths, seed)
    patches = notes.attempt("the score of smooth patches", make, None)
    return QualityReference(
        pictures, patches, reference.points.get("indirect") or next(iter(reference.points.values()))
    )


def trace_patches(scene: Scene, variable: Variable | None, count: int, paths: int, seed: int) -> PatchReference | None:
    """Trace the most lit flat patches among candidates with random held-out lights.

    Args:
        scene: What is lit.
        variable: The light that moves; None: the scene's own emitters light the patches.
        count: Patches.
        paths: Paths per point.
        seed: Seed of the bake.

    Returns:
        The patches; None where the scene has no flat surface.
    """
    candidates, light = _candidates(scene, variable, count, seed)
    number = len(candidates) // POINTS
    if not number:
        return None
    told = {"variable": None if variable is None else to_json(variable), "count": count, "seed": seed}

    def traced(patches: np.ndarray, each: int, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        recipe = Recipe("patches", told | {"each": each}, {"patches": patches.astype(np.uint32)})
        rows = _rows_of(patches, each)
        if variable is None:
            return static(scene, candidates[rows], paths, seed, recipe=recipe)
        return indirect(scene, candidates[rows], light[rows], variable, paths, seed, recipe=recipe)

    # The middle point of each patch shows which ones are lit.
    a, b = traced(np.arange(number), 1, PATCH_PILOT_PATHS, seed)
    chosen = _spread_of_lit((a + b).mean(axis=-1), count)
    a, b = traced(chosen, POINTS, paths, seed + EVALUATION_SEED)
    rows = _rows_of(chosen, POINTS)
    return PatchReference(candidates[rows], light[rows], a, b)


def _rows_of(patches: np.ndarray, each: int) -> np.ndarray:
    """Numbers of the first points of some patches among all candidates, ``each`` of every patch."""
    return (patches.astype(np.int64)[:, None] * POINTS + np.arange(each)).ravel()


def _candidates(scene: Scene, variable: Variable | None, count: int, seed: int) -> tuple[SurfacePoints, np.ndarray]:
    """Points of the patches that are chosen from, patch by patch, and their lights [N, 3]."""
    # Patches are scored in one pose: the one of the first view.
    pose = view_pose(scene, 0)
    points = draw_patches(standing(scene, pose), PATCH_CANDIDATES * count, seed + EVALUATION_SEED)
    points = points if pose is None else at_pose(points, pose)
    if variable is None:
        return points, np.zeros((len(points), 3), np.float32)
    lights = held_out_lights(scene, variable, PATCH_LIGHTS, seed + 4 * EVALUATION_SEED)
    return points, lights[np.arange(len(points)) // POINTS % len(lights)]


def patch_inputs(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Draw points of patches; see ``row_recipes.RecipeFunction``.

    Args:
        scene: What is lit.
        settings: ``variable``, ``count`` and ``seed``, as of ``trace_patches``, and ``each``, points of a patch.
        arrays: ``patches`` [K], numbers of patches among all candidates.

    Returns:
        Columns of ``SurfacePoints`` and, with a variable, ``light`` [N, 3].
    """
    variable = None if settings["variable"] is None else from_json(settings["variable"])
    points, light = _candidates(scene, variable, settings["count"], settings["seed"])
    rows = _rows_of(arrays["patches"], settings["each"])
    return Inputs(columns_of(points[rows]) | ({} if variable is None else {"light": light[rows]}))


def _spread_of_lit(value: np.ndarray, count: int) -> np.ndarray:
    """Indices of patches, the lit ones first (mean above the share of ``mottle``), in their random order."""
    bright = np.percentile(value, BRIGHT_PERCENTILE)
    return np.sort(np.argsort(value <= LIT_SHARE * bright, kind="stable")[:count])


# ---------------------------------------------------------------------- scores


def score_quality(
    truth: QualityReference, learned: Learned, shown: Callable[[ViewReference], np.ndarray] | None = None
) -> Quality:
    """Compute every figure of a field.

    Args:
        truth: What it is compared with.
        learned: The field of the points and patches.
        shown: View to [N, 3] radiance of all learned light at its points; None: ``learned`` alone.

    Returns:
        The figures.
    """
    shown = shown or (lambda view: learned(view.points, view.light))
    least = least_units(truth.pictures)
    pictures = [score_picture(picture, shown(picture.view), least) for picture in truth.pictures]
    psnr, flips, bare = (list(column) for column in zip(*pictures)) if pictures else ([], [], [])
    per_view = [None if found is None else found.db for found in psnr]
    blotches = _mottle(truth.patches, learned)
    bounds = {}
    if blotches.smooth.value is None and blotches.smooth.at_most is not None:
        bounds["mottle"] = blotches.smooth.at_most
    if any(found.is_lower_bound for found in psnr if found):
        bounds["psnr_db"] = _mean(per_view)
    points = truth.points
    f, y = learned(points.points, points.light), 0.5 * (points.half_a + points.half_b)
    unit = metrics.unit(y, points.weight)
    leak = metrics.leak(f, points.half_a, points.half_b, points.weight)
    margin = metrics.SIGNIFICANT * metrics.leak_noise(points.half_a, points.half_b, points.weight)
    if leak < margin:
        bounds["leak"] = leak + margin
    return Quality(
        psnr_db=_mean(per_view),
        flip=_mean(flips),
        flip_direct=_mean(bare),
        mottle=blotches.smooth.value,
        mottle_lit=blotches.lit.value,
        leak=leak,
        relative_error=metrics.relative_error(f / unit, y / unit, points.weight).mean,
        noise_floor=metrics.noise_floor(points.half_a / unit, points.half_b / unit, points.weight).mean,
        per_view=per_view,
        bounds=bounds,
    )


def least_units(pictures: Sequence[PictureReference]) -> tuple[float, float]:
    """Compute the smallest exposure units of views: ``MOST_STOPS`` below those of all views together.

    Args:
        pictures: The references of the views.

    Returns:
        The unit of indirect light and that of all light; 0 where all is black.
    """
    indirect = [0.5 * (picture.view.half_a + picture.view.half_b) for picture in pictures]
    whole = [picture.direct + y for picture, y in zip(pictures, indirect)]
    return _least_unit(indirect), _least_unit(whole)


def _least_unit(views: Sequence[np.ndarray]) -> float:
    every = np.concatenate(views) if views else np.zeros((0, 3))
    return ((picture_metrics.exposure_unit(every) if len(every) else None) or 0.0) / 2**MOST_STOPS


def score_picture(
    picture: PictureReference, f: np.ndarray, least: tuple[float, float] = (0.0, 0.0)
) -> tuple[NoiseFreePsnr | None, float | None, float | None]:
    """Compute figures of one view, exposed by the reference.

    Args:
        picture: The reference of the view.
        f: [N, 3] radiance of the field at the points of the view.
        least: Smallest exposure units, of indirect light and of all light, from ``least_units``.

    Returns:
        PSNR of the indirect light; FLIP of the whole picture and of direct light alone, against the denoised reference,
        because FLIP would count its noise. None where the reference is black.
    """
    view = picture.view
    y = 0.5 * (view.half_a + view.half_b)
    of_indirect, of_whole = picture_metrics.exposure_unit(y) if len(y) else None, None
    if of_indirect is None:
        return None, None, None
    of_indirect = max(of_indirect, least[0])
    image = lambda x: place(picture, x)  # noqa: E731
    parts = (f, view.half_a, view.half_b, picture.clean)
    psnr = picture_metrics.psnr_noise_free(*(image(x / of_indirect) for x in parts))
    of_whole = max(picture_metrics.exposure_unit(picture.direct + y) or 0.0, least[1])
    reference = image((picture.direct + picture.clean) / of_whole)
    learned, bare = (image((picture.direct + x) / of_whole) for x in (f, np.zeros_like(f)))
    return psnr, picture_metrics.flip(learned, reference), picture_metrics.flip(bare, reference)


def place(picture: PictureReference, values: np.ndarray) -> np.ndarray:
    """Arrange values at the points of a view as a picture.

    Args:
        picture: The view.
        values: [N, 3] values at its points.

    Returns:
        [H, W, 3] float64 picture, 0 elsewhere.
    """
    width, height = picture.size
    full = np.zeros((height * width, 3), np.float64)
    full[picture.view.seen] = values
    return full.reshape(height, width, 3)


def _mottle(patches: PatchReference | None, learned: Learned) -> Mottle:
    if patches is None:
        return Mottle(NOTHING, NOTHING, 0)
    f, a, b = (
        x.reshape(-1, POINTS, 3) for x in (learned(patches.points, patches.light), patches.half_a, patches.half_b)
    )
    return mottle(f, a, b)


def _mean(values: Sequence[float | None]) -> float | None:
    found = [v for v in values if v is not None]
    return float(np.mean(found)) if found else None
