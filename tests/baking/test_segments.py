"""Which expert answers where: from the outputs of a graph to the pictures of a report."""

from dataclasses import dataclass

import numpy as np
import pytest

from lightwell.baking import evaluate
from lightwell.baking.reference import trace_view
from lightwell.baking.reference_budget import ReferenceBudget
from lightwell.baking.view_setup import ViewSetup
from lightwell.fields.baked import Baked
from lightwell.fields.features import open_builder
from lightwell.fields.protocol import Lowered
from lightwell.report import borders
from lightwell.scenes import load
from lightwell.scenes.variables import declare
from lightwell.transport.queries import make_query

SIZE = (48, 32)


@pytest.fixture(scope="module")
def view():
    """(truth, light) of the built-in box seen by its first camera."""
    scene = load("cornell")
    variable = declare((), scene)
    camera, light = evaluate.views_and_lights(scene, variable, 1, 0)[0]
    return trace_view(scene, variable, camera, light, ("indirect",), SIZE, ReferenceBudget().pixel_paths // 8)


def graph(segments: bool):
    """One constant colour; experts 2 and 5 left and right of x = 0, the second one blended in where |x| < 0.2."""
    b = open_builder()
    outputs = {"radiance": b.affine("normal", [0, 0, 0], [0.1, 0.1, 0.1])}
    if segments:
        x = b.slice("position", 0, 1)
        left, right = (b.affine(x, [0], [k]) for k in (2, 5))
        near = b.subtract(b.affine(x, [0], [0.2]), b.length(x))
        outputs |= {
            "segment": b.select(x, right, left),
            "overlap": b.select(near, b.affine(x, [0], [0.3]), b.scale(x, 0)),
        }
    return b.build(**outputs)


def _alone(view) -> ViewSetup:
    """The light of a view, 1 cd."""
    return ViewSetup([(load("cornell").cameras[0], view.light)], 1.0, (1.0, 1.0, 1.0))


@dataclass
class Queries:
    """What a fit knows of points."""

    def query(self, points, light):
        return make_query(load("cornell"), points, light)


def shipped(segments: bool) -> evaluate.Shipped:
    lowered = Lowered(graph(segments))
    return evaluate.Shipped("indirect", Queries(), lowered, Baked(lowered.graph))


def test_one_network_has_no_segments(view):
    baked = shipped(False)
    compared = evaluate.compare_view(view, [baked], SIZE, "view", "", _alone(view), 0)
    assert not baked.baked.segmented and compared.regions is None and compared.blend is None


def test_every_pixel_knows_its_expert(view):
    baked = shipped(True)
    compared = evaluate.compare_view(view, [baked], SIZE, "view", "", _alone(view), 0)
    regions, blend = compared.regions.reshape(-1), compared.blend.reshape(-1)
    x = make_query(load("cornell"), view.points, view.light).position[:, 0]
    np.testing.assert_array_equal(regions[view.seen], np.where(x > 0, 5, 2))
    np.testing.assert_array_equal(blend[view.seen], np.abs(x) < 0.2)
    unseen = np.setdiff1d(np.arange(regions.size), view.seen)
    assert (regions[unseen] == evaluate.NO_REGION).all() and not blend[unseen].any()
    band = borders.border_band(compared.regions)
    assert 0 < band.sum() < band.size / 2
