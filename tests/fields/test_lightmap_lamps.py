"""Light maps of lamps: each has its own gloss, light adds up, and a pixel costs what the pictures cost."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from test_lightmap_field import SIZE, queries, ramp

from lightwell.asset.read import read_fields
from lightwell.asset.validate import validate_file
from lightwell.fields.base import query_inputs
from lightwell.fields.lightmap.curve import stored
from lightwell.fields.lightmap.fit import LightmapFit, LightmapPreset
from lightwell.fields.lightmap.lamp_map import LampMap
from lightwell.graph import evaluate
from lightwell.graph.pictures import encode

UNIT = 2.0
# Directions to what each lamp shows in the floor.
TOWARDS = np.array([[0.6, 0.8, 0.0], [-0.6, 0.8, 0.0]])
TINTS = np.array([[1.0, 0.5, 0.2], [0.2, 0.5, 1.0]])


def lamp_map(count: int = 2) -> LampMap:
    """Lamps whose light grows to the right and to the left, tinted; all beyond the second take of both pictures."""
    pictures = tuple(encode(stored(image), "png") for image in (ramp(), ramp()[:, ::-1].copy()))
    weights = np.zeros((count, 2, 3), np.float32)
    weights[0, 0], weights[1, 1], weights[2:] = TINTS[0], TINTS[1], 0.1
    return LampMap(tuple(f"lamp {k}" for k in range(count)), pictures, weights, np.full(count, 1 / count))


def fit_of(lamps: LampMap, channels: int = 3) -> LightmapFit:
    preset = LightmapPreset("png", channels=channels, share=0.25, hidden=(16, 16), inputs="mirror", rate=1e-2)
    return LightmapFit(preset, SIZE, UNIT, encode(stored(ramp()), "png"), batch=1 << 10, lamps=lamps)


def shares(query) -> np.ndarray:
    """[N, 2, 3] a E' of each lamp, and its lobe in the floor."""
    mirrored = query.view * [-1, 1, -1]
    lobe = np.exp(8 * (np.einsum("nc,kc->nk", mirrored, TOWARDS) - 1))
    u = query.uv1[:, :1]
    place = np.stack([0.1 + 0.4 * u, 0.1 + 0.4 * (1 - u)], axis=1)
    albedo = query.reflectance - 0.04
    return UNIT * TINTS * (albedo[:, None] * place + 0.04 * 4 * lobe[..., None])


def radiance(graph, query, *dimmers) -> np.ndarray:
    factors = np.array([np.broadcast_to(d, 3) for d in dimmers], np.float32).T.reshape(1, -1)
    inputs = {name: value for name, value in query_inputs(query).items() if name in graph.inputs}
    inputs["lamps"] = np.repeat(factors, len(query), axis=0)
    return evaluate(graph, inputs)["radiance"] * query.reflectance


@pytest.fixture(scope="module")
def learned() -> LightmapFit:
    query, fit = queries(1 << 13), fit_of(lamp_map())
    alone = shares(query)
    fit.train(query, alone.sum(axis=1), np.ones(len(query), np.float32), 300, shares=alone)
    return fit


def test_each_lamp_has_its_own_gloss(learned):
    query, graph = queries(1024), learned.lower()
    wanted = shares(query)
    for k, dimmers in enumerate([(1, 0), (0, 1)]):
        found = radiance(graph, query, *dimmers)
        diffuse = (query.reflectance - 0.04) * np.abs(wanted[:, k])
        error = np.abs(found - wanted[:, k]).mean() / wanted[:, k].mean()
        assert error < 0.1, f"lamp {k}: {error:.1%}"
        # Without its lobe a lamp would be further off.
        assert error < 0.5 * np.abs(diffuse - wanted[:, k]).mean() / wanted[:, k].mean()


def test_light_adds_up_and_none_is_left_of_lamps_that_are_off(learned):
    query, graph = queries(256), learned.lower()
    alone = [radiance(graph, query, *dimmers) for dimmers in ((1, 0), (0, 1))]
    assert min(a.min() for a in alone) >= 0 and not radiance(graph, query, 0, 0).any()
    tinted = radiance(graph, query, (2, 0, 0.5), (0, 1, 3))
    expected = alone[0] * [2, 0, 0.5] + alone[1] * [0, 1, 3]
    np.testing.assert_allclose(tinted, expected, rtol=1e-3, atol=1e-6)


def test_a_pixel_reads_as_many_pictures_for_any_number_of_lamps():
    graphs = [fit_of(lamp_map(count), channels=0).lower() for count in (8, 64)]
    assert graphs[0].fetches == graphs[1].fetches and graphs[0].macs == graphs[1].macs
    assert graphs[1].nbytes - graphs[0].nbytes < 56 * 1000


def test_a_file_is_read_back_as_it_was_written():
    """The fixture of the web runtime; its numbers are those of NumPy before it was written."""
    folder = Path(__file__).parents[2] / "web/test/fixtures"
    fields, _ = read_fields(folder / "lightmap-lamps.glb")
    told = json.loads((folder / "lightmap-lamps.json").read_text())
    inputs = {name: np.array(rows, np.float32) for name, rows in told["inputs"].items()}
    found = evaluate(fields[0].graph, inputs)["radiance"]
    np.testing.assert_allclose(found, told["outputs"]["radiance"], rtol=1e-3, atol=1e-5)
    assert validate_file(folder / "lightmap-lamps.glb") == []
    dark = evaluate(fields[0].graph, inputs | {"lamps": np.zeros_like(inputs["lamps"])})["radiance"]
    assert found.max() > 0 and not dark.any()


def test_shares_are_needed():
    query = queries(64)
    with pytest.raises(ValueError, match="lamps that have switches need the light of each"):
        fit_of(lamp_map()).train(query, shares(query).sum(axis=1), np.ones(64, np.float32), 2)
