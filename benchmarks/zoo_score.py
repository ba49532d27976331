"""Scores one baked scene for benchmarks/zoo.py: quality.json and quality.jpg beside the asset.

python benchmarks/zoo_score.py SCENE FOLDER
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from lightwell.asset.read import read_fields
from lightwell.baking.display_pictures import display_view
from lightwell.baking.evaluate import views_and_lights
from lightwell.baking.quality import (
    DIRECT_PATHS,
    Learned,
    PictureReference,
    Quality,
    least_units,
    score_quality,
    trace_quality,
)
from lightwell.baking.reference_budget import ReferenceBudget
from lightwell.core.color import display
from lightwell.fields.baked import Baked
from lightwell.report.picture_metrics import exposure_unit
from lightwell.scenes import load
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable, declare
from lightwell.transport import direct
from lightwell.transport.queries import make_query

VIEWS, SIZE = 4, (160, 100)
BUDGET = ReferenceBudget(points=4096, point_paths=256, pixel_paths=256)
# How many times the difference of displayed values is shown.
DIFFERENCE = 4


def strip(
    scene: Scene, variable: Variable, camera: Camera, picture: PictureReference, learned: Learned, least: float
) -> np.ndarray:
    """[H, 3 W, 3] whole picture with learned light, denoised reference and difference, displayed, of one view."""
    large, light = display_view(scene, camera, picture.view, picture.size), picture.view.light
    bare = large.picture(direct(scene, large.points, light, variable, DIRECT_PATHS))
    reference = bare + large.reference
    unit = max(exposure_unit(reference) or 0.0, least) or 1.0
    lit, truth = (display(x / unit) for x in (bare + large.picture(learned(large.points, light)), reference))
    return np.concatenate([lit, truth, np.clip(DIFFERENCE * np.abs(lit - truth), 0, 1)], axis=1)


def score(source: str, folder: Path) -> tuple[Quality, list, list[np.ndarray]]:
    """The figures of a bake, its graphs, and a strip of each view."""
    scene = load(source)
    variable = declare((), scene)
    entries, _ = read_fields(folder / "scene.glb")
    baked = next(Baked(entry.graph) for entry in entries if entry.role == "indirect")
    views = views_and_lights(scene, variable, VIEWS, 0)
    truth = trace_quality(scene, variable, views, SIZE, BUDGET, 0)
    learned = lambda points, light: baked(make_query(scene, points, light))  # noqa: E731
    least = least_units(truth.pictures)[1]
    strips = [
        strip(scene, variable, camera, picture, learned, least) for (camera, _), picture in zip(views, truth.pictures)
    ]
    return score_quality(truth, learned), [entry.graph for entry in entries], strips


def main() -> None:
    source, folder = sys.argv[1], Path(sys.argv[2])
    quality, graphs, strips = score(source, folder)
    figures = quality.json() | {"bytes": sum(g.nbytes for g in graphs), "macs": sum(g.macs for g in graphs)}
    image = Image.fromarray((255 * np.concatenate(strips)).astype(np.uint8))
    image.save(folder / "quality.jpg", quality=85)
    (folder / "quality.json").write_text(json.dumps(figures))


if __name__ == "__main__":
    main()
