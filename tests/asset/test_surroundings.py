"""What is looked at of a scene, and what is seen behind it, in the file."""

import numpy as np
import pytest

from lightwell.asset.container import pack, unpack
from lightwell.asset.records import EXTENSION, EnvironmentEntry, LampEntry
from lightwell.asset.schema import validate
from lightwell.asset.validate import validate_file
from lightwell.asset.write import glb_bytes
from lightwell.graph.pictures import encode
from lightwell.scenes.scene import Mesh

PICTURE = encode(np.full((4, 8, 3), 90, np.uint8), "webp90")


def written(tmp_path, *args, change=None, **kwargs):
    """The extension of a file, and the problems that its validation finds."""
    document, binary = unpack(glb_bytes(*args, **kwargs))
    if change:
        change(document["extensions"][EXTENSION])
    path = tmp_path / "scene.glb"
    path.write_bytes(pack(document, binary))
    return document, validate_file(path)


def test_a_room_has_neither(tmp_path, scene, entry, variable):
    document, problems = written(tmp_path, scene, [entry], [variable])
    assert not {"core", "environment"} & document["extensions"][EXTENSION].keys() and not problems


def test_a_dome_of_sky_is_not_part_of_the_core(tmp_path, scene, entry, variable):
    corners = 200 * np.float32([[-1, 0, -1], [1, 0, -1], [1, 0.5, 1], [-1, 0.5, 1]])
    scene.meshes.append(Mesh("dome", corners, np.uint32([[0, 2, 1], [0, 3, 2]]), 0))
    document, problems = written(tmp_path, scene, [entry], [variable])
    core = document["extensions"][EXTENSION]["core"]
    assert core == {"low": scene.core[0].tolist(), "high": scene.core[1].tolist()} and not problems
    assert np.ptp([core["low"], core["high"]], axis=0).max() < 2


def test_an_environment_is_a_radiance_a_picture_and_a_lamp(tmp_path, scene, entry, variable):
    sky = EnvironmentEntry((1.0, 2.0, 3.0))
    document, problems = written(tmp_path, scene, [entry], [variable], environment=sky)
    extension = document["extensions"][EXTENSION]
    assert extension["environment"] == {"radiance": [1.0, 2.0, 3.0]} and extension["version"] == 1 and not problems
    sky = EnvironmentEntry((2.0, 2.0, 2.0), PICTURE, lamp=0)
    document, problems = written(tmp_path, scene, [entry], [variable], environment=sky, lamps=[LampEntry("sky")])
    found = document["extensions"][EXTENSION]["environment"]
    image = document["textures"][found["texture"]]["extensions"]["EXT_texture_webp"]["source"]
    assert found["lamp"] == 0 and document["images"][image]["mimeType"] == "image/webp" and not problems


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"core": {"low": [0, 0, 0], "high": [1, 0, 1]}}, "core: expected low below high"),
        ({"environment": {"radiance": [1, -1, 1]}}, r"environment.radiance\[1\]: -1 is less than the minimum of 0"),
        ({"environment": {"radiance": [1, 1, 1], "lamp": 0}}, "environment.lamp: there is no lamp 0"),
        ({"environment": {}}, "environment: 'radiance' is a required property"),
    ],
)
def test_what_breaks_a_rule_is_refused(more, text):
    nodes = [{"id": "y", "op": "normalize", "inputs": ["position"]}]
    graph = {"version": 1, "inputs": {"position": 3}, "buffers": {}, "nodes": nodes, "outputs": {"radiance": "y"}}
    extension = {"version": 1, "variables": [], "fields": [{"name": "still", "role": "static", "graph": graph}]}
    validate(extension)
    with pytest.raises(ValueError, match=text):
        validate(extension | more)


def test_a_texture_that_is_not_there_is_a_problem(tmp_path, scene, entry, variable):
    sky = {"radiance": [1, 1, 1], "texture": 99}
    _, problems = written(tmp_path, scene, [entry], [variable], change=lambda e: e.update(environment=sky))
    assert problems == ["environment: there is no texture 99; name one of the file, or leave it out"]
