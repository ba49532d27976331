"""Godot's files: a strict parser of its text resources, the tree of planes, the harmonics. Never run in Godot."""

import configparser

import lark
import numpy as np
import pytest

from lightwell.engines.godot import node_name
from lightwell.engines.godot_probes import EMPTY, Tree, tetrahedra
from lightwell.engines.probe_grid import filled, read_grid
from lightwell.exr.chunks import read_header
from lightwell.exr.decoding import decode_parts
from lightwell.limits import Limits
from lightwell.probes import sh
from lightwell.probes.lattice import ProbeLattice

# Godot documentation, "TSCN file format": headings with attributes, then name = value.
RESOURCE = lark.Lark(
    r"""
    start: section+
    section: "[" WORD attribute* "]" property*
    attribute: WORD "=" value
    property: WORD "=" value
    ?value: NUMBER -> number | STRING -> string | ("true" | "false") -> boolean | call | list | dictionary
    call: WORD ["[" WORD "]"] "(" [value ("," value)*] ")"
    list: "[" [value ("," value)*] "]"
    dictionary: "{" [STRING ":" value ("," STRING ":" value)*] "}"
    WORD: /[A-Za-z_][A-Za-z0-9_\/]*/
    NUMBER: /-?\d+(\.\d+)?(e[+-]?\d+)?/
    STRING: /"([^"\\]|\\["\\])*"/
    %ignore /\s+/
    """,
    parser="lalr",
)
LATTICE = ProbeLattice(np.array([-1.0, 0.5, 2.0]), 0.5, (4, 3, 5))


def numbers_of(tree: lark.Tree) -> list[float]:
    return [float(child.children[0]) for child in tree.children if isinstance(child, lark.Tree)]


@pytest.fixture(scope="module")
def probe_data(exported):
    tree = RESOURCE.parse((exported("godot") / "light_map.tres").read_text())
    [dictionary] = tree.find_data("dictionary")
    pairs = iter(dictionary.children)
    return {str(key)[1:-1]: value for key, value in zip(pairs, pairs)}


def test_the_resources_follow_the_format(exported, probe_data):
    tree = RESOURCE.parse((exported("godot") / "lightwell.tscn").read_text())
    assert [str(s.children[0]) for s in tree.find_data("section")] == ["gd_scene", *["ext_resource"] * 2, *["node"] * 3]
    users = (exported("godot") / "light_map.tres").read_text()
    assert 'NodePath("../Scene/floor"), Rect2(0, 0, 1, 1), 0, -1, NodePath("../Scene/wall")' in users
    assert set(probe_data) == {"baked_exposure", "bounds", "bsp", "interior", "points", "sh", "tetrahedra"}
    with pytest.raises(lark.exceptions.LarkError):
        RESOURCE.parse('[gd_resource type="X"]\n[resource]\na = [1, ]\n')
    assert node_name("a.b:c") == "a_b_c"


def test_the_import_file_makes_one_slice_of_the_picture(exported):
    config = configparser.ConfigParser(strict=True)
    config.read(exported("godot") / "light_map.exr.import")
    assert config["remap"]["importer"] == '"2d_array_texture"'
    assert (config["params"]["slices/horizontal"], config["params"]["slices/vertical"]) == ("1", "1")


def test_the_picture_holds_the_light_map(exported, bake_folder):
    from lightwell.engines.bake import read_bake

    expected = read_bake(bake_folder).light_map
    path = exported("godot") / "light_map.exr"
    budget = Limits().budget("light map")
    [part] = decode_parts(path, read_header(path, budget), [0], 60)
    found = np.stack([part.flat[c] for c in "RGB"], axis=2)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert expected.shape == (16, 16, 3) and expected.max() > 0.05


def test_godots_sum_of_the_harmonics_is_irradiance_over_pi(probe_data, bake_folder):
    grid = read_grid([bake_folder / "probes-static.lwp"])
    stored = np.array(numbers_of(probe_data["sh"])).reshape(-1, 9, 4)[..., :3]
    normals = sh.directions(7)
    x, y, z = normals.T
    # scene_forward_lights / lightmap capture of Godot's shaders.
    c = (0.886227, 1.023328, 0.858086, 0.247708, 0.429043)
    terms = [c[0] + 0 * x, c[1] * y, c[1] * z, c[1] * x, c[2] * x * y, c[2] * y * z]
    terms += [0.743125 * z * z - c[3], c[2] * x * z, c[4] * (x * x - y * y)]
    found = np.einsum("kn,pkc->pnc", np.array(terms), stored)
    expected = np.stack([sh.evaluate(e, normals) for e in grid.irradiance]) / np.pi
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())
    assert np.array(numbers_of(probe_data["points"])).size == 3 * len(grid.lattice)


def test_tetrahedra_fill_the_lattice():
    corners = LATTICE.nodes()[tetrahedra(LATTICE)]
    edges = corners[:, 1:] - corners[:, :1]
    volumes = np.abs(np.linalg.det(edges)) / 6
    assert volumes.sum() == pytest.approx(np.prod(np.array(LATTICE.cells) * 0.5)) and volumes.min() > 0.02


def walk(rows: np.ndarray, point: np.ndarray) -> int:
    """As Godot's `lightmap_tap_sh_light` walks the tree."""
    planes, node = rows[:, :4].copy().view(np.float32), 0
    while node >= 0:
        over = planes[node, :3] @ point > planes[node, 3]
        node = int(rows[node, 4 if over else 5])
    assert node != EMPTY
    return -node - 1


def test_the_tree_finds_the_tetrahedron_of_every_point():
    rows, parts = Tree(LATTICE).numbers(), tetrahedra(LATTICE)
    nodes = LATTICE.nodes()
    rng = np.random.default_rng(1)
    for point in rng.uniform(nodes.min(axis=0), nodes.max(axis=0), (300, 3)):
        corners = nodes[parts[walk(rows, point)]]
        shares = np.linalg.solve(np.vstack([corners.T, np.ones(4)]), [*point, 1])
        assert shares.min() > -1e-5
    assert rows.dtype == np.int32 and len(rows) < 6 * LATTICE.cell_count + 1


def test_probes_in_walls_take_the_light_of_the_nearest():
    alive = np.zeros(len(LATTICE), bool)
    alive[[0, -1]] = True
    light = np.zeros((len(LATTICE), 9, 3))
    light[0], light[-1] = 1, 2
    out = filled(light, alive, LATTICE)
    assert out[1].max() == 1 and out[-2].min() == 2 and set(np.unique(out)) == {1, 2}


def test_the_shaders_of_fields_lie_beside(exported):
    assert "vec3 lightwell_lightmap(" in (exported("godot") / "lightwell_lightmap.gdshaderinc").read_text()
    assert (exported("godot") / "lightwell_lightmap_picture0.png").exists()
