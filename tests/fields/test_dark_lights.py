"""A light that reaches nothing is refused by its name, with the cure."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.fields.base import radiance_unit
from lightwell.scenes.sky import Sky
from lightwell.scenes.variables import PointLight, Sun
from lightwell.transport.samples import Samples

ARC = ((1.0, 0.1, 0.0), (0.0, 1.0, 0.1), (-1.0, 0.1, 0.0))
WHITE_SKY = Sky((0.0, 1.0), ((0.0,) * 3,) * 2, ((0, 0, 1, 0, 0, 0, 0, 0, 0) * 3,) * 2, (1.0, 1.0), 3.0)


@pytest.mark.parametrize(
    "light, said",
    [
        (None, "no light of the scene's own reaches any sampled surface point; bake with --no-static"),
        (
            PointLight((0, 0, 0), (1, 1, 1), 0.1, name="torch"),
            "no indirect light of 'torch' reaches any sampled surface point; move it into the scene's air with "
            "--vary torch.position=box(",
        ),
        (
            Sun(*ARC, name="sun"),
            "no indirect light of the sun 'sun' reaches any sampled surface point: the scene has no "
            "opening to it; drop sun.direction from --vary",
        ),
        (
            Sun(*ARC, name="day", sky=WHITE_SKY),
            "of sun and sky 'day' reaches any sampled surface point: the scene has no "
            "opening to it; drop 'day' from --vary",
        ),
    ],
)
def test_a_light_that_lights_nothing_is_refused_by_its_name(light, said):
    black = np.zeros((16, 3), np.float32)
    dark = Samples(SimpleNamespace(), black, black, np.ones(16, np.float32), np.zeros(16, np.uint32))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=re.escape(said)):
        radiance_unit(dark, light)


def test_one_bright_sample_does_not_make_the_others_black():
    radiance = np.random.default_rng(0).random((20_000, 3)).astype(np.float32)
    lit = Samples(SimpleNamespace(), radiance, radiance, np.ones(20_000, np.float32), np.zeros(20_000, np.uint32))  # type: ignore[arg-type]
    unit = radiance_unit(lit)
    assert unit == pytest.approx(4 * radiance.mean(), rel=1e-5)
    radiance[7] = 1e7
    assert unit < radiance_unit(lit) < 1.02 * unit
