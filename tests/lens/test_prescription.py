"""Bokeh of a lens prescription: the lensmaker's equation, exact rays, aberrations by their known signs, errors."""

from pathlib import Path

import numpy as np
import pytest

from lightwell.lens import families, prescription
from lightwell.lens.camera import LensCamera
from lightwell.lens.engine import Engine
from lightwell.lens.errors import LensError
from lightwell.lens.layers import Layer
from lightwell.lens.library_cache import LibraryCache
from lightwell.lens.recipes import Recipe
from lightwell.lens.report import Report
from lightwell.lens.settings import LensSettings

DOUBLE_GAUSS = prescription.read(Path(__file__).parents[2] / "examples/lens/double-gauss-50mm.txt")
CAMERA = LensCamera(focus=2.5, fstop=2.2, focal=0.05)


def singlet(first=60.0, second=-40.0, thick=6.0, index=1.5, diameter=30.0, stop=10.0) -> prescription.Prescription:
    """A stop before a single lens; millimetres."""
    return prescription.parse(f"0 1 1 {stop}\n{first} {thick} {index} {diameter}\n{second} 5 1 {diameter}\n")


def test_focal_length_is_that_of_the_lensmaker():
    n, r1, r2, d = 1.5, 0.060, -0.040, 0.006
    expected = 1 / ((n - 1) * (1 / r1 - 1 / r2 + (n - 1) * d / (n * r1 * r2)))
    assert singlet().focal == pytest.approx(expected, rel=1e-9)
    # Printed: 50 mm, rounded radii and indices.
    assert DOUBLE_GAUSS.focal == pytest.approx(0.050, rel=0.01)


def test_a_ray_through_a_plano_convex_lens_is_exact():
    # Parallel to the axis at height h, through the plane first: sin of the angles at the curved side is h/R and n h/R.
    h, radius, n = 0.008, 0.040, 1.5
    lens = prescription.parse("0 1 1 20\n0 5 1.5 30\n-40 5 1 30")
    p, d, place, alive = lens.trace(np.array([[h, 0, -0.01]]), np.array([[0.0, 0.0, 1.0]]))
    assert alive.all() and place[0, 0] == pytest.approx(h)
    slope = np.tan(np.arcsin(n * h / radius) - np.arcsin(h / radius))
    assert d[0, 0] / d[0, 2] == pytest.approx(-slope, rel=1e-12)
    assert p[0, 2] == pytest.approx(0.006 - (radius - np.sqrt(radius**2 - h**2)), rel=1e-9)


def test_total_reflection_and_rims_stop_rays():
    lens = prescription.parse("0 1 1 60\n0 5 1.9 60\n-30 5 1 58")
    heights = np.array([0.0, 0.010, 0.020, 0.0299])
    origin = np.column_stack([heights, np.zeros(4), np.full(4, -0.01)])
    *_, alive = lens.trace(origin, np.tile([0.0, 0.0, 1.0], (4, 1)))
    # n h / R < 1: 0.0158 m.
    assert alive.tolist() == [True, True, False, False]


def test_near_the_axis_it_is_the_thin_lens():
    mounted = prescription.mount(DOUBLE_GAUSS, CAMERA, 960, 540)
    assert mounted.strength == pytest.approx(CAMERA.strength(960), rel=0.005)
    closed = prescription.mount(DOUBLE_GAUSS, LensCamera(focus=2.5, fstop=16, focal=0.05), 960, 540)
    for s in (2.0, -2.0):
        reach = np.abs(closed.rays(s, 0.0)).max()
        assert reach == pytest.approx(2.0, rel=0.03)
    # In focus all light meets in a point, but for what aberrations leave.
    assert np.abs(closed.rays(0.0, 0.0)).max() < 0.1


def test_spherical_aberration_softens_the_rim_behind_the_focus_and_brightens_it_in_front():
    # Under-corrected: rays of the rim cross the axis before those of the middle, so that behind the focus they have
    # spread farther when they arrive, and in front of it less far.
    lens = singlet(stop=12.0)
    mounted = prescription.mount(lens, LensCamera(focus=2.5, fstop=lens.focal / 0.0118, focal=0.05), 1920, 1080)

    def rim(s):
        far = np.hypot(*mounted.rays(s, 0.0).T)
        return np.mean(far > 0.9 * far.max()) / 0.19

    assert rim(-12.0) > 1.15 > 0.9 > rim(12.0)


def test_corners_are_vignetted_and_symmetric():
    mounted = prescription.mount(DOUBLE_GAUSS, CAMERA, 960, 540)
    middle, half, corner = (mounted.rays(6.0, field) for field in (0.0, 0.7, 1.0))
    assert len(corner) < 0.5 * len(middle) and len(corner) < len(half) < len(middle)
    # A cat's eye: the rims of the front and the back cut the sides that look towards the middle and away from it.
    assert np.abs(half[:, 1]).max() > 1.1 * np.abs(half[:, 0]).max()
    kernel = mounted.kernel(6.0, 1.0)
    assert kernel.sum() == pytest.approx(1) and (kernel >= 0).all()
    np.testing.assert_allclose(kernel, kernel[::-1], atol=1e-12)
    # The chief ray lies on the pixel: what is left of the disc is not far from it.
    x = np.arange(kernel.shape[1]) - kernel.shape[1] // 2
    assert abs((kernel.sum(axis=0) * x).sum()) < 1.0


def test_kernels_are_turned_by_the_azimuth(tmp_path):
    mounted = prescription.mount(DOUBLE_GAUSS, CAMERA, 96, 96)
    family = families.prescription(4.0, mounted)
    engine = Engine(family, Recipe(), LibraryCache(keep=False))
    sides = []
    for y, x in ((48, 92), (92, 48)):
        rgba = np.zeros((96, 96, 4), np.float32)
        rgba[y, x] = 1
        picture = engine.blur(Layer(rgba, np.full((96, 96), 3.0, np.float32), None), Report())[..., 0]
        rows, columns = np.indices(picture.shape)
        spread = [np.sqrt((picture * (v - c) ** 2).sum() / picture.sum()) for v, c in ((rows, y), (columns, x))]
        sides.append(spread)
    # On the right edge the blur is tall, on the lower edge it is wide, and just as much.
    assert sides[0][0] > 1.1 * sides[0][1] and sides[1][1] > 1.1 * sides[1][0]
    assert sides[0][0] == pytest.approx(sides[1][1], rel=0.1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2 3", "line 1: expected radius, distance"),
        ("0 1 1 10\n50 5 9 20", "line 2"),
        ("50 5 1.5 20\n-50 5 1 20", "0 stops"),
        ("0 1 1 10", "1 surfaces"),
        ("0 1 1 10\n-50 5 1.5 20\n50 5 1 20", "does not focus"),
    ],
)
def test_mistakes_are_told_in_one_line(text, said):
    with pytest.raises(LensError, match=said) as error:
        _ = prescription.parse(text, "x.txt").focal
    assert "x.txt" in str(error.value) and "\n" not in str(error.value)


def test_what_does_not_go_together_is_refused():
    with pytest.raises(LensError, match=r"opens to f/2.03 only"):
        prescription.mount(DOUBLE_GAUSS, LensCamera(fstop=1.4), 960, 540)
    with pytest.raises(LensError, match="aperture and vignetting of its own"):
        LensSettings(prescription=DOUBLE_GAUSS, cats_eye=1.0)
    with pytest.raises(LensError, match=r"no-such.txt \(No such file"):
        prescription.read("no-such.txt")
