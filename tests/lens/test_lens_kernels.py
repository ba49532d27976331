"""Kernels, constraints, recipes and quantisation against closed forms and dense solves."""

import numpy as np
import pytest

from lightwell.lens import families, points, psf, voronoi
from lightwell.lens.anneal import published, working
from lightwell.lens.aperture import DISC, from_picture, polygon
from lightwell.lens.bake import bake_node
from lightwell.lens.lsq import solve_values
from lightwell.lens.moments import constraints, harmonics
from lightwell.lens.quantise import quantise_charges
from lightwell.lens.recipes import Recipe, lossless, primal, sparse
from lightwell.lens.score import integrate, plane_of, score


def _laplacian(h):
    return h[1:-1, 2:] + h[1:-1, :-2] + h[2:, 1:-1] + h[:-2, 1:-1] - 4 * h[1:-1, 1:-1]


def test_harmonic_polynomials_are_harmonic_on_the_lattice():
    y, x = np.mgrid[-9:10, -9:10].astype(float)
    for h in harmonics(x, y, 6):
        assert np.abs(_laplacian(h)).max() < 1e-6
    plain = ((x + 1j * y) ** 4).real
    assert np.abs(_laplacian(plain)).max() > 1, "the plain fourth power is not: the correction matters"


def test_a_kernels_own_charges_fulfil_every_constraint():
    kernel = psf.shaped(polygon(5, 13.0), 7.3)
    f = psf.charges(kernel)
    x, y = psf.offsets(f)
    c, d = constraints(x.ravel(), y.ravel(), kernel)
    assert np.abs(c @ f.ravel() - d).max() < 1e-12


@pytest.mark.parametrize("radius", [2.0, 7.7, 23.1])
def test_disc_has_unit_mass_and_its_second_moment(radius):
    kernel = psf.capsule(radius)
    x, y = psf.offsets(kernel)
    assert kernel.sum() == pytest.approx(1)
    # A disc has r²/2, the pixel's box adds 1/6.
    assert (kernel * (x**2 + y**2)).sum() == pytest.approx(radius**2 / 2 + 1 / 6, rel=0.05)


def test_capsule_is_a_disc_along_a_segment():
    joint, shaped = psf.capsule(5.0, 12.0), psf.shaped(DISC, 5.0, 12.0, 0.0)
    h, w = (min(a, b) for a, b in zip(joint.shape, shaped.shape))

    def middle(k):
        return k[(k.shape[0] - h) // 2 :, (k.shape[1] - w) // 2 :][:h, :w]

    assert np.abs(middle(joint) - middle(shaped)).sum() < 0.01


def test_aperture_appears_mirrored_in_front_of_focus():
    heart = np.zeros((40, 40))
    heart[:20, :] = 1
    heart[20:30, 10:20] = 1
    shape = from_picture(heart)
    behind, front = psf.shaped(shape, 8.0), psf.shaped(shape, -8.0)
    assert np.allclose(behind, front[::-1, ::-1], atol=1e-12)
    assert np.abs(behind - front).sum() > 0.1


def test_mask_is_centred_on_its_centroid():
    picture = np.zeros((64, 64))
    picture[5:25, 30:60] = 1
    kernel = psf.shaped(from_picture(picture), 10.0)
    x, y = psf.offsets(kernel)
    assert abs((kernel * x).sum()) < 0.05 and abs((kernel * y).sum()) < 0.05


@pytest.mark.parametrize("kernel", [psf.capsule(6.3), psf.capsule(4.0, 9.0), psf.shaped(polygon(6), 9.0)])
def test_lossless_is_the_dense_kernel(kernel):
    s = lossless(kernel)
    assert s.score.error < 1e-3 and abs(s.score.mass) < 1e-4
    f = psf.charges(kernel)
    y, x = np.nonzero(f)
    exact = integrate(x - f.shape[1] // 2, y - f.shape[0] // 2, f[y, x], plane_of(kernel))
    assert score(kernel, exact).error < 1e-9, "unquantised it is exact to rounding"


@pytest.mark.parametrize("radius, length", [(8.0, 0.0), (24.0, 0.0), (12.0, 24.0)])
def test_sparse_keeps_energy_and_leaks_little(radius, length):
    family = families.depth(radius) if not length else families.depth_speed(radius, length)
    made = dict(bake_node(family, family.size - 1, Recipe()))[0]
    assert made.recipe == "sparse"
    assert len(made) < 0.35 * np.count_nonzero(family.kernel(family.size - 1))
    assert made.score.error < 0.2 and made.score.leak < 0.03
    assert abs(made.score.mass) < 1e-4 and made.score.centroid < 0.01
    assert int(made.q.astype(int).sum()) == 0


def test_without_the_mass_constraint_energy_is_lost():
    kernel = psf.capsule(16.0)
    density = points.density(psf.charges(kernel))
    px, py = points.rounded(points.lloyd(density, points.seeded(density, 70, np.random.default_rng(1)), 20))
    kept, _ = solve_values(kernel, px, py)
    lost, _ = solve_values(kernel, px, py, mass=False, centroid=False)
    mass = [abs(score(kernel, integrate(px, py, v, plane_of(kernel))).mass) for v in (kept, lost)]
    assert mass[0] < 1e-5 < mass[1]


def test_quantised_charges_sum_to_exactly_zero():
    rng = np.random.default_rng(0)
    for _ in range(50):
        values = rng.normal(size=rng.integers(2, 400)) * 10.0 ** rng.uniform(-6, 2)
        values -= values.mean()
        q, scale = quantise_charges(values)
        assert int(q.astype(int).sum()) == 0
        assert np.abs(q * scale - values).max() <= 1.01 * scale


def test_primal_keeps_its_mass():
    s = primal(psf.capsule(3.3))
    assert s.values.sum() == pytest.approx(1, abs=1e-6) and s.score.error < 1e-3


def test_same_seed_same_spreadlet():
    kernel = psf.capsule(10.0, 8.0)
    a, b = (sparse(kernel, 70, Recipe(), 5) for _ in range(2))
    assert all(np.array_equal(getattr(a, n), getattr(b, n)) for n in "xyq") and a.scale == b.scale


def test_voronoi_cells_share_the_pixels_exactly():
    rng = np.random.default_rng(2)
    charges = psf.charges(psf.capsule(6.0))
    at = rng.uniform(-6, 6, (25, 2))
    values = voronoi.integrate_cells(charges, at)
    assert abs(values.sum()) < 1e-12
    # Oracle: 32×32 samples in every pixel.
    fine = 32
    rows, columns = np.nonzero(charges)
    sub = (np.arange(fine) + 0.5) / fine - 0.5
    expected = np.zeros(len(at))
    for r, c in zip(rows, columns):
        x, y = np.meshgrid(c - charges.shape[1] // 2 + sub, r - charges.shape[0] // 2 + sub)
        nearest = ((x.ravel()[:, None] - at[:, 0]) ** 2 + (y.ravel()[:, None] - at[:, 1]) ** 2).argmin(1)
        expected += charges[r, c] * np.bincount(nearest, minlength=len(at)) / fine**2
    assert np.abs(values - expected).max() < 0.02 * np.abs(expected).max()


def test_working_annealing_improves_and_the_published_one_hardly():
    kernel = psf.capsule(7.0, 12.0)
    f = psf.charges(kernel)
    density = points.density(f)
    px, py = points.rounded(points.lloyd(density, points.seeded(density, 50, np.random.default_rng(3)), 30))
    values = voronoi.integrate_cells(f, np.stack([px, py], 1).astype(float))
    good, bad = working(kernel, px, py, values, visits=8), published(kernel, px, py, steps=60)
    assert good.curve.min() < 0.7 * good.curve[0]
    assert good.curve.min() / good.curve[0] < bad.curve[-1] / bad.curve[0]


def test_paper_preset_integrates_to_something_like_the_kernel():
    family = families.depth(9.0)
    made = dict(bake_node(family, family.size - 1, Recipe("paper", share=0.2)))
    assert made[0].recipe == "voronoi" and made[0].score.error < 0.6
    assert made[1].score.error < 1e-3


def test_poisson_darts_keep_their_distance():
    weight = np.ones((21, 21))
    darts = points.poisson(weight, 2.0, 0.5, np.random.default_rng(0), 500, rejections=300)
    distance = np.hypot(*(darts[:, None] - darts[None]).transpose(2, 0, 1)) + 99 * np.eye(len(darts))
    assert len(darts) > 30 and distance.min() >= 2.0


def test_cats_eye_narrows_towards_the_corner_and_keeps_unit_mass():
    family = families.cats_eye(12.0, 1.0)
    n = len(family.radius)
    middle, corner = family.kernel(n - 1), family.kernel(len(family.length) * n - 1)
    assert np.count_nonzero(corner) < 0.8 * np.count_nonzero(middle)
    assert middle.sum() == pytest.approx(1) and corner.sum() == pytest.approx(1)
