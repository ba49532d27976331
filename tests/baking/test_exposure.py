"""The exposure that a bake declares: middle grey for the views, the same at every run."""

import numpy as np
import pytest

from lightwell.baking.evaluate import lit_views
from lightwell.baking.exposure import METER_VIEWS, exposure_of, metered_exposure
from lightwell.baking.view_setup import ViewSetup
from lightwell.core.color import MIDDLE_GREY
from lightwell.scenes import load
from lightwell.scenes.variables import declare


def flat(value: float) -> np.ndarray:
    return np.full((2, 3, 3), value)


def test_half_way_between_the_first_and_the_brightest_picture():
    assert exposure_of([flat(MIDDLE_GREY / 4)]) == 4.0
    assert exposure_of([flat(MIDDLE_GREY / 4), flat(MIDDLE_GREY)]) == 2.0
    # A darker one beside the first changes nothing, nor does what is black or not finite.
    assert exposure_of([flat(MIDDLE_GREY / 4), flat(1e-3)]) == 4.0
    assert exposure_of([np.concatenate([flat(MIDDLE_GREY / 4), flat(0.0), flat(np.nan)])]) == 4.0
    assert exposure_of([flat(0.0)]) == 1.0
    # What a file may declare.
    assert (exposure_of([flat(1e9)]), exposure_of([flat(1e-5)])) == (1e-6, 1.8e4)


@pytest.mark.slow
def test_metered_by_any_number_of_views_it_is_the_same_and_follows_the_light():
    scene = load("cornell")
    variable = declare(("light.position=box(-0.5,0.5,-0.5,0.5,1.5,0.5)",), scene)

    def metered(views: int, intensity: float) -> float:
        setup = ViewSetup(lit_views(scene, variable, views, 0), intensity, (1.0, 1.0, 1.0))
        return metered_exposure(scene, variable, setup, 0, False)

    # The number of views that a bake is scored in changes nothing.
    once = metered(1, 2.0)
    assert once == metered(METER_VIEWS, 2.0) > 0
    assert once == pytest.approx(4 * metered(1, 8.0), rel=0.06)  # two significant digits
