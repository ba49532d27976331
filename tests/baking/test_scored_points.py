"""Points at which lights are scored in several poses."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.baking.poses import scored_points
from lightwell.scenes import load
from lightwell.scenes.posing import declared_movers, with_movers
from lightwell.scenes.variables import PointLight, declare
from lightwell.transport.lit_points import LitPoints


@pytest.mark.slow
def test_lights_of_one_bake_are_scored_at_the_same_points_which_are_drawn_once():
    scene = load("doorway")
    scene = with_movers(scene, declared_movers(["node:Door.rotation=y:0..90"], scene))
    lamp = PointLight((-2.2, 0.4, -1.0), (2.2, 2.0, 1.0), 0.1)
    sun = declare(["sun.direction=arc(150,20,210,20)"], scene)
    first = scored_points(scene, LitPoints(lamp, 90, 3, floor=0, lights=8, light_seed=1))
    second = scored_points(scene, LitPoints(sun, 90, 3, floor=0, lights=4, light_seed=2))
    assert first is second and len(np.unique(first[0].pose)) == 9
    assert scored_points(scene, LitPoints(lamp, 90, 4, floor=0)) is not first
