"""A light map of a room with two lamps of its own: a switch for each, whose light is that of its lamp, path traced."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset.read import read_fields
from lightwell.asset.records import FieldEntry
from lightwell.asset.validate import validate_file
from lightwell.baking.pipeline import bake
from lightwell.core.lamps import parse_lamps
from lightwell.engines.light_map import light_map
from lightwell.fields.baked import Baked
from lightwell.fields.lightmap import field as field_module
from lightwell.fields.lightmap import fitting
from lightwell.fields.lightmap.curve import restored
from lightwell.scenes import load
from lightwell.scenes.dimmed import dimmed
from lightwell.scenes.lamps import group_lamps
from lightwell.transport import static
from lightwell.transport.irradiance import irradiance
from lightwell.transport.lightmap_query import query_of_lightmap
from lightwell.transport.surface import draw_surface
from tests.baking.conftest import small
from tests.baking.test_lamps_bake import room

LIGHTMAP = dict(field="lightmap", quality="draft", shards=1, steps=120, paths=32, lights_per_shard=32, views=1)


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    """(folder, report, fit) of a bake whose network is kept."""
    folder, fits = tmp_path_factory.mktemp("lightmap-lamps"), []
    made = field_module.lamp_errors
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fitting, "shown_error", lambda fit, samples: 0.0 if fit.preset.hidden else 1.0)
        patch.setattr(field_module, "lamp_errors", lambda fit: fits.append(fit) or made(fit))
        settings = small(
            folder / "out",
            scene=str(room(folder / "room.glb")),
            lamps=("name",),
            options={"size": 64, "mips": 0},
            **LIGHTMAP,
        )
        report = bake(settings)
    return folder, report, fits[-1]


@pytest.fixture(scope="module")
def field(baked) -> FieldEntry:
    """The field of the file."""
    return read_fields(baked[0] / "out" / "scene.glb")[0][0]


def lit(field: FieldEntry, *dimmers: float) -> FieldEntry:
    """The field with lamps at other factors than 1 where it is shown as baked."""
    known = field.graph.buffers["lamp_weights"]
    columns = np.tile(np.float32(dimmers), 3)
    table = {"lamp_weights": replace(known, array=known.array * columns)}
    return replace(field, graph=replace(field.graph, buffers={**field.graph.buffers, **table}))


def shown(field: FieldEntry, query, *dimmers) -> np.ndarray:
    """[N, 3] what the file shows; dimmers are numbers or colours of each lamp."""
    factors = np.array([np.broadcast_to(d, 3) for d in dimmers], np.float32)
    return Baked(field.graph, {"lamps": factors.T.ravel()})(query)


@pytest.fixture(scope="module")
def seen(baked):
    """Scene of the bake, points, and their queries."""
    scene = load(str(baked[0] / "room.glb"))
    points = draw_surface(scene, 768, 1, floor=8).points
    return scene, points, query_of_lightmap(scene, baked[2].state.atlas, points)


@pytest.mark.slow
def test_the_file_has_a_switch_for_each_lamp(baked, field):
    folder, report, _ = baked
    assert validate_file(folder / "out") == []
    data = (folder / "out" / "scene.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + length])
    extension = document["extensions"]["LIGHTWELL_neural_radiance"]
    assert extension["version"] == 2
    assert [(lamp["name"], lamp["nodes"]) for lamp in extension["lamps"]] == [("warm", ["warm"]), ("cool", ["cool"])]
    assert field.graph.inputs["lamps"] == 6 and {"e0", "e1", "m", "f0"} <= set(field.graph.buffers)
    assert "e" not in field.graph.buffers
    assert all("MOZ_lightmap" in m["extensions"] for m in document["materials"])
    facts = report["facts"]
    assert list(facts["error_of_each_lamp"]) == ["warm", "cool"] and facts["lamp_pictures"] == 2
    assert facts["error_of_random_lamps"] > 0


@pytest.mark.slow
def test_each_lamp_alone_is_as_path_traced(baked, field, seen):
    """The stored irradiance of a lamp is that of the scene in which the others are dark; its radiance about that."""
    scene, points, query = seen
    groups = group_lamps(scene, parse_lamps(("name",)))
    rows = np.random.default_rng(2).choice(np.flatnonzero(baked[2].chart.stored), 512)
    texels = baked[2].chart.texels
    for name, other, dimmers in (("warm", "cool", (1, 0)), ("cool", "warm", (0, 1))):
        with dimmed(scene, groups, {other: (0, 0, 0)}):
            irradiance_of = irradiance(scene, texels.points[rows], 256, 3).mean
            radiance = np.mean(static(scene, points, 128, 3), axis=0)
        image = light_map([lit(field, *dimmers)], []).reshape(-1, 3)[texels.index[rows]]
        np.testing.assert_allclose(image.mean(axis=0), irradiance_of.mean(axis=0), rtol=0.06)
        assert np.abs(image - irradiance_of).mean() < 0.1 * irradiance_of.mean(), name
        # So few steps of training leave an error that the pictures do not have.
        assert np.abs(shown(field, query, *dimmers) - radiance).mean() < 0.25 * radiance.mean(), name


@pytest.mark.slow
def test_light_adds_up_and_a_lamp_that_is_off_is_dark(field, seen):
    query = seen[2]
    warm, cool = shown(field, query, 1, 0), shown(field, query, 0, 1)
    assert warm.min() >= 0 and cool.min() >= 0
    np.testing.assert_allclose(shown(field, query, 1, 1), warm + cool, rtol=2e-3, atol=1e-5)
    tinted = shown(field, query, (0.5, 0, 2), (0, 3, 0))
    np.testing.assert_allclose(tinted, warm * [0.5, 0, 2] + cool * [0, 3, 0], rtol=2e-3, atol=1e-5)
    assert not shown(field, query, 0, 0).any()


@pytest.mark.slow
def test_all_lamps_are_the_light_map_of_all(baked, field):
    """With every dimmer at 1 the file has the path traced map of the whole scene, but for the codec of its pictures."""
    made, fit = baked[2].chart, baked[2].map
    texels = made.texels.index[made.stored]
    pictures = (light_map([field], []), made.image, fit.unit * restored(fit.base.texels))
    found, whole, plain = (image.reshape(-1, 3)[texels] for image in pictures)
    np.testing.assert_allclose(found.mean(axis=0), whole.mean(axis=0), rtol=0.02)
    assert np.abs(found - whole).mean() < 1.5 * np.abs(plain - whole).mean()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"lamps": ("desk=Desk*",)},
            r"'desk=Desk\*' matches no light of scene .*; its lights are 'warm', 'cool'",
        ),
        ({"lamps": ("each",), "static": False, "vary": ("light.position=box(-.5,.5,-.5,.5,1,.5)",)}, "--no-static"),
        ({"lamps": ("each",), "preset": "siren"}, "preset 'siren' has no ordinary light map .*; use --preset default"),
        ({"lamps": ("each",), "options": {"max_bytes": "100kB"}}, "--max-bytes chooses .* leave --lamps out"),
    ],
)
def test_what_cannot_be_is_one_line_with_the_cure(tmp_path, change, message):
    with pytest.raises(ValueError, match=message) as error:
        bake(small(tmp_path / "out", scene=str(room(tmp_path / "room.glb")), **{**LIGHTMAP, **change}))
    assert "\n" not in str(error.value)


def test_a_scene_without_a_light_of_its_own_has_no_lamps(tmp_path: Path):
    with pytest.raises(ValueError, match="has no light of its own; leave out --lamps, or add lights to it"):
        bake(small(tmp_path / "out", scene="cornell", lamps=("each",), **LIGHTMAP))
