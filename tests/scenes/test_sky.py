"""The numbers of a sky: the formula, which the web runtime evaluates alike, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset.schema import validate
from lightwell.core.vary import of_options
from lightwell.scenes.sky import COLUMNS, ROWS, Sky, cell_directions, light_of_sphere

VECTORS = json.loads((Path(__file__).parent / "sky_vectors.json").read_text())


def test_light_of_the_vectors_that_the_web_runtime_reads_too():
    sky = Sky.of(VECTORS["sky"])
    assert sky.json() == VECTORS["sky"]
    for row in VECTORS["rows"]:
        found = sky.radiance(row["time"], np.array(row["sun"]), np.array(row["view"]))
        np.testing.assert_allclose(found, row["radiance"], rtol=1e-6)
        np.testing.assert_allclose(sky.sunlight(np.array(row["time"])), row["sunlight"], rtol=1e-6)
        assert np.interp(row["time"], sky.times, sky.level) == pytest.approx(row["level"], rel=1e-6)


def test_cells_are_directions_above_the_horizon_of_one_solid_angle():
    directions = cell_directions()
    assert directions.shape == (ROWS * COLUMNS, 9, 3) and directions[..., 1].min() > 0
    # The irradiance of a floor under an even sky is π.
    assert 2 * np.pi * directions[..., 1].mean() == pytest.approx(np.pi, rel=1e-3)
    even = np.full((ROWS * COLUMNS, 3), 1 / (2 * np.pi))
    assert light_of_sphere(np.ones(3), even) == pytest.approx(2, rel=1e-6)


def extension(version: int = 2, **changed) -> dict:
    arc = {"start": [1, 0, 0], "middle": [0, 1, 0], "end": [-1, 0, 0], "initial": [0, 1, 0]}
    sky = {**VECTORS["sky"], **changed}
    none = {"id": "none", "op": "affine", "inputs": ["position"], "scale": [0.0] * 3, "offset": [0.0] * 3}
    graph = {"version": 1, "inputs": {"position": 3}, "buffers": {}, "nodes": [none], "outputs": {"radiance": "none"}}
    field = {"name": "indirect", "role": "indirect", "variable": 0, "graph": graph}
    sun = {"name": "day", "kind": "sun", **arc, "intensity": 1, "color": [1, 1, 1], "sky": sky}
    return {"version": version, "variables": [sun], "fields": [field]}


def test_a_sky_is_valid_from_version_2_on():
    validate(extension())
    with pytest.raises(ValueError):
        validate(extension(version=1))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"times": [0.0, 0.4, 0.9]}, "sky.times: expected increasing numbers from 0 to 1"),
        ({"level": [0.1, 1.0]}, "sky.level: expected as many as times, 3, found 2"),
        ({"hours": [9.0, 8.0, 20.0]}, "sky.hours: expected three increasing hours"),
        ({"turbidity": 20}, "20 is greater than the maximum of 10"),
        ({"model": [[0.0] * 26] * 3}, "is too short"),
    ],
)
def test_a_sky_with_other_numbers_is_refused_in_one_line(changed, message):
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        validate(extension(**changed))
    assert message in str(error.value)


def test_options_of_the_sun_become_declarations():
    day = "day=2026-06-21,48.1,11.6"
    found = of_options((day,), north=30.0, turbidity=2.0)
    assert found == (day, "day.north=30", "day.turbidity=2") == of_options(found, north=30.0, turbidity=2.0)
    assert of_options((), north=None) == ()
    with pytest.raises(ValueError, match=r"^vary: --north is for a sun; add --vary day=2026"):
        of_options(("light.radius=1",), north=30.0)
    with pytest.raises(ValueError, match="a turbidity lies between 1 and 10"):
        of_options((day,), turbidity=12.0)
