"""Probes in the file of a field: written, read, validated and listed; what breaks the format is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset.export import export_field
from lightwell.asset.info import info
from lightwell.asset.read import read_fields, read_light
from lightwell.asset.records import FieldEntry
from lightwell.asset.schema import validate
from lightwell.asset.validate import validate_file
from lightwell.asset.write import write_glb
from lightwell.graph import Builder
from lightwell.scenes.assemble import assemble
from lightwell.scenes.scene import Material
from tests.transport.rooms import room_walls


def entry(scale: float, **inputs: int) -> FieldEntry:
    """A static field that is a multiple of its first input."""
    b = Builder(**(inputs or {"position": 3}))
    first = next(iter(inputs), "position")
    return FieldEntry("static", "static", b.build(radiance=b.linear(first, np.full((3, 3), scale), np.zeros(3))))


@pytest.fixture
def written(tmp_path) -> Path:
    scene = assemble("room", room_walls(), [Material("white")], digest="room")
    write_glb(tmp_path / "scene.glb", scene, [entry(1.0)], [], probes=[entry(2.0)])
    return tmp_path / "scene.glb"


def extension(path: Path) -> dict:
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + length])["extensions"]["LIGHTWELL_neural_radiance"]


def test_both_are_read_back(written):
    fields, probes, _ = read_light(written)
    assert read_fields(written)[0][0].name == fields[0].name and extension(written)["version"] == 2
    weights = [next(iter(found[0].graph.buffers.values())).values() for found in (fields, probes)]
    np.testing.assert_allclose(weights[1], 2 * weights[0])
    assert validate_file(written) == []
    told = info(written)
    assert [probe["name"] for probe in told["probes"]] == ["static"] and told["probe_bytes"] == told["field_bytes"] > 0


def test_the_light_in_the_air_is_exported_too(written):
    walls, air = (export_field(written, "glsl", field=name).text for name in ("static", "probes:static"))
    # Scaled by 1 and by 2.
    assert "2." in air and walls != air
    with pytest.raises(ValueError, match="no field 'probes:air'; it has 'static', 'probes:static'"):
        export_field(written, "glsl", field="probes:air")


@pytest.mark.parametrize(
    "change, said",
    [
        ({"version": 1}, ".probes: nothing of that name in version 1"),
        ({"probes": []}, "should be non-empty"),
        ({"probes": "inputs"}, "'view' is not one of"),
        ({"probes": "twice"}, "probes: two entries have the same name"),
        ({"probes": "light"}, "probes[0].variable: there is no light 3"),
    ],
)
def test_what_breaks_the_format_is_refused(written, change, said):
    json_, (probe,) = extension(written), extension(written)["probes"]
    made = {
        "inputs": [{**probe, "graph": {**probe["graph"], "inputs": {"position": 3, "view": 3}}}],
        "twice": [probe, probe],
        "light": [{**probe, "variable": 3}],
    }
    json_ |= {name: made.get(value, value) if isinstance(value, str) else value for name, value in change.items()}
    with pytest.raises(ValueError) as error:
        validate(json_)
    assert said in str(error.value) and len(str(error.value).splitlines()) == 1
