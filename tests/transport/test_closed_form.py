"""Scenes whose radiance is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.scenes.variables import Sun
from lightwell.transport import paths, radiance
from lightwell.transport.interactions import interaction
from lightwell.transport.queries import make_query
from lightwell.transport.radiance import PathReport, direct, indirect, static
from lightwell.transport.surface import sample_surface

from . import rooms

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.8])
def test_furnace(albedo):
    # Every wall emits 1: radiance 1 / (1 - ρ), of which ρ is direct and ρ² / (1 - ρ) indirect light.
    scene = rooms.furnace(albedo)
    points = sample_surface(scene, 1024, 1)
    total, shallow = (np.mean(static(scene, points, 128, 2, max_depth=d)) for d in (64, 2))
    # 131,072 paths with a relative deviation of at most 2 each: 0.6 %, taken 3 times.
    assert shallow == pytest.approx(albedo, rel=0.02)
    assert total - shallow == pytest.approx(albedo**2 / (1 - albedo), rel=0.03)


def test_furnace_default_depth_is_deep_enough():
    # What longer paths than the default hold in a closed room of albedo 0.8, relative: ρ^30 = 0.12 %.
    assert 0.8 ** (paths.MAX_DEPTH - 2) < 2e-3


def test_lit_plane(roaming):
    # L = ρ/π cos θ / d², with nothing but rounding; nothing else is there to light the plane.
    scene = rooms.plane(0.5)
    points = sample_surface(scene, 512, 3, is_open=True)
    light = np.float32([0.2, 1.3, -0.4])
    query = make_query(scene, points, light)
    offset = light - query.position
    distance = np.linalg.norm(offset, axis=1)
    cosine = offset[:, 1] / distance
    above = np.array(interaction(scene, points).to_world(interaction(scene, points).wi).y) > 0
    expected = np.where(above, 0.5 / np.pi * cosine / distance**2, 0)
    np.testing.assert_allclose(direct(scene, points, light, roaming)[:, 0], expected, rtol=1e-4, atol=1e-7)
    a, b = indirect(scene, points, light, roaming, 8, 4)
    assert not a.any() and not b.any()


def test_corner_lit_by_the_sun():
    # A sun in the zenith lights the floor alone, with 1 lx. A wall of the corner then sees a floor of radiance ρ/π:
    # one bounce is ρ/π times the irradiance of that polygon (Lambert).
    albedo = 0.5
    floor = rooms.quad("floor", (-1, 0, 0), (0, 0, 2), (2, 0, 0))
    wall = rooms.quad("wall", (-1, 0, 0), (2, 0, 0), (0, 1, 0))
    scene = rooms.build("corner", [floor, wall], [rooms.diffuse([albedo] * 3)] * 2)
    points = sample_surface(scene, 4096, 5, is_open=True)
    query = make_query(scene, points, np.float32([0, 1, 0]))
    front = np.flatnonzero((points.shape == 1) & (query.normal[:, 2] > 0) & (query.position[:, 1] > 0.05))[:64]
    variable = Sun((1, 0, 0), (0, 1, 0), (-1, 0, 0))
    a, b = indirect(scene, points[front], np.float32([0, 1, 0]), variable, 1 << 14, 6, max_depth=3)
    corners = floor.positions.astype(np.float64)
    expected = np.array([polygon_irradiance(corners, x, (0, 0, 1)) for x in query.position[front].astype(np.float64)])
    expected *= albedo / np.pi * albedo / np.pi
    # Each path finds the floor or not: relative error sqrt((1 - p) / (p n)) <= 4 % at p >= 0.04, taken 4 times.
    np.testing.assert_allclose((a + b)[:, 0] / 2, expected, rtol=0.16)
    # ... and of the mean of 64 points 0.5 %, taken 4 times.
    assert (a + b).mean() / 2 == pytest.approx(expected.mean(), rel=0.02)


def polygon_irradiance(corners: np.ndarray, x: np.ndarray, normal) -> float:
    """Irradiance at x from a polygon of radiance 1, wholly above the plane of x (Lambert 1760)."""
    d = corners - x
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    e = np.roll(d, -1, axis=0)
    cross = np.cross(d, e)
    length = np.linalg.norm(cross, axis=1)
    angle = np.arctan2(length, (d * e).sum(axis=1))
    return abs(float(((angle / length)[:, None] * cross).sum(axis=0) @ np.asarray(normal, np.float64)) / 2)


def test_no_finite_path_is_lost_with_the_broken_ones(monkeypatch, cornell, roaming):
    # One path in four turns NaN: the mean stays, the report counts them.
    trace = radiance.trace

    def broken(scene, si, source, rng, *rest):
        L = trace(scene, si, source, rng, *rest)
        return radiance.dr.select(rng.next_float32() < 0.25, float("nan"), L)

    points = sample_surface(cornell, 4096, 7)
    whole = np.mean(indirect(cornell, points, (0, 1.5, 0), roaming, 64, 8))
    monkeypatch.setattr(radiance, "trace", broken)
    report = PathReport()
    a, b = indirect(cornell, points, (0, 1.5, 0), roaming, 64, 8, report=report)
    assert np.isfinite(a).all() and np.isfinite(b).all()
    # 262,144 paths: the count is within 4 standard deviations (0.0034) of a quarter.
    assert report.paths == 4096 * 64
    assert report.dropped / report.paths == pytest.approx(0.25, abs=0.0034)
    # The same paths less a quarter: noise of 1.5 % of the mean, taken 4 times.
    assert np.mean([a, b]) == pytest.approx(whole, rel=0.06)


def test_a_point_without_finite_paths_is_nan_and_counted(monkeypatch, cornell, roaming):
    monkeypatch.setattr(radiance, "trace", lambda scene, si, *rest: radiance.mi.Spectrum(si.p.x * float("nan")))
    report = PathReport()
    a, _ = indirect(cornell, sample_surface(cornell, 16, 9), (0, 1.5, 0), roaming, 4, 0, report=report)
    assert np.isnan(a).all() and report.points == 16 and report.dropped == 64


def test_paths_must_be_even(cornell, roaming):
    with pytest.raises(ValueError, match="paths = 3, expected an even number"):
        indirect(cornell, sample_surface(cornell, 4, 1), (0, 1, 0), roaming, 3, 0)


def test_chunks_do_not_change_the_result(cornell, roaming):
    # Streams belong to (seed, point, path): only the order of single-precision sums differs.
    points = sample_surface(cornell, 64, 10)
    whole = indirect(cornell, points, (0, 1.5, 0), roaming, 256, 3)
    parts = indirect(cornell, points, (0, 1.5, 0), roaming, 256, 3, launch=1024)
    np.testing.assert_allclose(parts, whole, rtol=1e-4, atol=1e-7)


def test_a_blended_surface_shines_as_if_it_covered_all(roaming):
    # What is seen through it is the rasteriser's; the plate is too small to change the room.
    walls = rooms.room_walls()
    plate = rooms.quad("plate", (-0.01, 1.0, -0.01), (0, 0, 0.02), (0.02, 0, 0))
    white = rooms.diffuse(rooms.WHITE)
    found = []
    for blended in (white, {"type": "mask", "opacity": 0.1, "bsdf": white}):
        scene = rooms.build("plate", [*walls, plate], [white] * len(walls) + [blended])
        points = sample_surface(scene, 4096, 5, floor=256)
        points = points[np.flatnonzero(points.shape == len(walls))]
        a, b = indirect(scene, points, (0.3, 1.6, 0.2), roaming, 256, 3)
        found.append((direct(scene, points, (0.3, 1.6, 0.2), roaming).mean(), np.mean(0.5 * (a + b))))
    # 256 points and paths: half a per cent of noise.
    np.testing.assert_allclose(found[1], found[0], rtol=0.03)


@pytest.mark.parametrize("roughness", [0.0, 0.5])
def test_glass_shines_by_what_it_reflects(roaming, roughness):
    # What is seen through it, sharp or blurred, is the rasteriser's. Its index of refraction is nearly 1, so that the
    # rest is its diffuse light: 1 - transmission of that of an opaque plate.
    walls = rooms.room_walls()
    plate = rooms.quad("plate", (-0.01, 1.0, -0.01), (0, 0, 0.02), (0.02, 0, 0))
    found = []
    for transmission in (0.0, 0.7):
        glass = {"type": "principledthin", "spec_trans": transmission, "roughness": roughness, "eta": 1.001}
        scene = rooms.build("plate", [*walls, plate], [rooms.diffuse(rooms.WHITE)] * len(walls) + [glass])
        points = sample_surface(scene, 4096, 5, floor=256)
        points = points[np.flatnonzero(points.shape == len(walls))]
        a, b = indirect(scene, points, (0.3, 1.6, 0.2), roaming, 512, 3)
        found.append((direct(scene, points, (0.3, 1.6, 0.2), roaming).mean(), np.mean(0.5 * (a + b))))
    # 256 points and 512 paths, three in ten of which are reflected: 1 % of noise.
    np.testing.assert_allclose(found[1], 0.3 * np.array(found[0]), rtol=0.04)


def test_the_far_side_of_frosted_glass_is_dark():
    # A pane before a lamp, in empty space: from the other side all of its light is light that it lets through.
    pane = rooms.quad("pane", (-1, 0, -1), (0, 0, 2), (2, 0, 0))
    lamp = rooms.quad("lamp", (-1, 1, -1), (2, 0, 0), (0, 0, 2))
    shine = {"type": "area", "radiance": {"type": "rgb", "value": [1.0] * 3}}
    glass = {"type": "principledthin", "spec_trans": 0.5, "roughness": 0.5, "eta": 1.5}
    scene = rooms.build("pane", [pane, lamp], [glass, rooms.diffuse([0.0] * 3)], [None, shine])
    points = sample_surface(scene, 1024, 5, is_open=True)
    points = points[np.flatnonzero(points.shape == 0)]
    below = points.view[:, 1] < 0
    a, b = static(scene, points, 64, 3)
    assert not a[below].any() and not b[below].any()
    assert (a + b)[~below].mean() > 0.1
