"""Sheets: planes of thin walls that cut probes off, on a room that a wall without thickness divides."""

from dataclasses import replace

import numpy as np
import pytest

from lightwell.probes.bake import bake_geometry, rebake, with_bricks
from lightwell.probes.sheets import ALL_CORNERS, Sheets, changed_nodes, cut_off
from lightwell.probes.support import cube_valid
from lightwell.probes.volume import OPEN, query
from lightwell.scenes.assemble import assemble
from lightwell.scenes.scene import Material
from tests.transport.rooms import box, quad

# Where the wall stands, and the spacing of the probes, which no wall coincides with.
WALL, SPACING, OFFSET = 0.13, 0.9, (0.3, 0.1, 0.7)


def room(*walls):
    """A closed room of 6 x 3 x 3 m."""
    shell = box("shell", (-3, 0, 0), (3, 3, 3), inward=True)
    name = " ".join(["room", *(str(wall.positions.tolist()) for wall in walls)])
    grey = Material("grey", (0.5, 0.5, 0.5, 1), metallic=0.0)
    return assemble(name, [shell, *walls], [grey, replace(grey, name="sheet", double_sided=True)], digest=name)


def wall(low: float = 0.0, high: float = 3.0, slant: float = 0.0):
    """A sheet at x = WALL, ``slant`` metres further at its other end."""
    return quad("wall", (WALL, low, 0), (slant, 0, 3), (0, high - low, 0), material=1)


@pytest.fixture(scope="module", params=[0.0, 0.8], ids=["straight", "slanted"])
def divided(request):
    return request.param, bake_geometry(room(wall(slant=request.param)), SPACING, "relu-field", OFFSET)


def beyond(x: np.ndarray, slant: float) -> np.ndarray:
    """[N] distance from the wall, along x."""
    return x[:, 0] - WALL - slant * x[:, 2] / 3


def lit(geometry, slant: float):
    """Light of 1 at the probes on one side of the wall, and of 1,000 at those on the other."""
    far = beyond(geometry.support.origin[: len(geometry.volume.lattice)], slant) > 0
    light = np.zeros((len(geometry.volume.state), 9, 3), np.float32)
    light[:, 0] = np.where(far, 1000.0, 1.0)[:, None] * np.sqrt(4 * np.pi)
    return geometry.volume.lit(light * geometry.volume.alive[:, None, None]).in_air()


def asked(slant: float, count: int = 4000) -> np.ndarray:
    """Places in the room, 1 cm and more from its walls."""
    x = np.random.default_rng(0).uniform([-2.9, 0.1, 0.1], [2.9, 2.9, 2.9], (count, 3))
    return x[np.abs(beyond(x, slant)) > 0.01]


def test_nothing_leaks_through_a_wall_without_thickness(divided):
    slant, geometry = divided
    volume, x = lit(geometry, slant), asked(slant)
    truth = np.where(beyond(x, slant) > 0, 1000.0, 1.0)
    up = np.repeat([[0.0, 1, 0]], len(x), axis=0)
    ratio = query(volume, x, up)[0][:, 0] / truth
    assert len(volume.sheets.plane) > 10
    # A plane is stored to a thousandth of a cell, and a slanted one is found from what blocks segments.
    assert (np.abs(ratio - 1) < 0.02).mean() >= (1.0 if slant == 0 else 0.998)
    # A planted bug: without its sheets the volume leaks, and loses what its records do not hold.
    bare = replace(volume, sheets=Sheets.none(volume.lattice.cell_count))
    assert (np.abs(query(bare, x, up)[0][:, 0] / truth - 1) > 0.5).mean() > 0.04


def test_probes_beside_a_wall_need_no_record(divided):
    slant, geometry = divided
    volume = geometry.volume
    live = volume.alive & geometry.support.stands
    assert (volume.state[live] == OPEN).mean() > (0.9 if slant == 0 else 0.8)


def test_a_probe_is_cut_off_where_it_is_not_trusted(divided):
    _, geometry = divided
    level = geometry.levels[0]
    off = cut_off(level.sheets, level.support, level.nodes)[:, : level.points]
    valid = cube_valid(level.support, level.nodes)
    # Where it is cut off there is hardly any trust; where nothing cuts, there is all that the target has.
    assert off.any() and level.target[:, : level.points][off & valid].astype(float).mean() < 0.02


def test_the_end_of_a_wall_cuts_nothing_off():
    geometry = bake_geometry(room(wall(high=1.6)), SPACING, "relu-field", OFFSET)
    volume = geometry.volume
    x = asked(0.0)
    above = x[(x[:, 1] > 2.0) & (np.abs(x[:, 0] - WALL) < 1.0)]
    light = np.zeros((len(volume.state), 9, 3), np.float32)
    light[:, 0] = np.sqrt(4 * np.pi)
    e, z = query(volume.lit(light).in_air(), above, np.repeat([[0.0, 1, 0]], len(above), axis=0))
    assert np.abs(e - 1).max() < 1e-3 and np.quantile(z, 0.01) > 0.3


def test_a_room_without_thin_walls_has_no_sheets():
    volume = bake_geometry(room(), SPACING, "relu-field", OFFSET).volume
    assert len(volume.sheets.plane) == 0 and (volume.sheets.row == -1).all()


@pytest.mark.slow
def test_an_edited_wall_is_baked_as_a_whole_bake_does():
    before, after = room(wall(high=1.6), wall(low=1.6)), room(wall(high=1.6))
    made = bake_geometry(before, SPACING, "relu-field", OFFSET)
    cell = np.unique(made.volume.lattice.cell_number(made.volume.lattice.locate(np.array([[WALL, 1.5, 1.4]]))[0]))
    made = with_bricks(before, made, cell)
    found, again = rebake(after, made, np.array([[WALL - 0.01, 1.59, -0.01], [WALL + 0.01, 3.01, 3.01]]))
    whole = with_bricks(after, bake_geometry(after, SPACING, "relu-field", OFFSET), cell)
    for name in ("state", "row", "params", "octant", "fallback"):
        assert np.array_equal(getattr(found.volume, name), getattr(whole.volume, name)), name
    for name in ("row", "plane", "corners"):
        assert np.array_equal(getattr(found.volume.sheets, name), getattr(whole.volume.sheets, name)), name
    assert np.array_equal(found.volume.bricks.sheet, whole.volume.bricks.sheet)
    assert (whole.volume.bricks.sheet >= 0).any()
    lattice = made.volume.lattice
    changed = changed_nodes(lattice, made.levels[0].sheets, found.levels[0].sheets)
    assert 0 < len(changed) < len(lattice) and set(changed) <= set(again.tolist())


def test_corners_count_by_the_side_of_their_plane():
    rng = np.random.default_rng(3)
    plane = rng.normal(size=(6, 4))
    corners = rng.integers(0, ALL_CORNERS, 6).astype(np.uint16)
    plane[2] = 0
    sheets = Sheets.of_cells(plane, corners)
    assert sheets.row.tolist() == [0, 1, -1, 2, 3, 4]
    again = Sheets.of_cells(*sheets.of_all())
    assert np.array_equal(again.row, sheets.row) and np.array_equal(again.plane, sheets.plane)
    cell, f = rng.integers(0, 6, 300), rng.random((300, 3))
    found = sheets.counted(sheets.row[cell], f)
    for k in range(300):
        side = 8 * int(f[k] @ sheets.plane[max(sheets.row[cell[k]], 0), :3] + sheets.plane[sheets.row[cell[k]], 3] > 0)
        expected = [cell[k] == 2 or bool(int(corners[cell[k]]) >> (side + c) & 1) for c in range(8)]
        assert found[k].tolist() == expected
