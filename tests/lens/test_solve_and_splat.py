"""The solve, the pyramids, and every scatter against its shortest version."""

import numpy as np
import pytest

from lightwell.lens import families, fixed, pyramid, reference, solve
from lightwell.lens.bake import bake_node
from lightwell.lens.choose import choose, uniform
from lightwell.lens.psf import capsule
from lightwell.lens.recipes import Recipe, lossless, primal
from lightwell.lens.splat import Frame, Points, Sources, guard_for, splat


def laplacian(image: np.ndarray) -> np.ndarray:
    """Compute f = 4K − Σ neighbours of an image [..., height, width] that is odd about its edges."""
    k = np.pad(image, [(0, 0)] * (image.ndim - 2) + [(1, 1), (1, 1)], mode="edge")
    for rim in (k[..., 0, :], k[..., -1, :], k[..., 0], k[..., -1]):
        np.negative(rim, out=rim)
    inner = k[..., 1:-1, 1:-1]
    return 4 * inner - k[..., :-2, 1:-1] - k[..., 2:, 1:-1] - k[..., 1:-1, :-2] - k[..., 1:-1, 2:]


def test_solve_inverts_the_laplacian_of_random_images():
    image = np.zeros((3, 61, 80))
    image[:, 20:-20, 20:-20] = np.random.default_rng(0).random((3, 21, 40))
    assert np.abs(solve.dst(laplacian(image)) - image).max() < 1e-12
    assert np.abs(solve.fft(laplacian(image)) - image).max() < 1e-12
    charges = np.random.default_rng(1).normal(size=(50, 41))
    assert np.abs(laplacian(solve.dst(charges)) - charges).max() < 1e-12


def test_smooth_sizes_have_no_large_primes():
    for n in (97, 510, 1151, 2047):
        size = solve.smooth_size(n)
        assert size >= n
        for prime in (2, 3, 5, 7, 11):
            while size % prime == 0:
                size //= prime
        assert size == 1


@pytest.mark.parametrize("kernels, error, mass", [(pyramid.FIVE, 0.09, 0.5), (pyramid.SEVEN, 0.06, 0.8)])
def test_pyramids_integrate_a_disc_about_right(kernels, error, mass):
    image = np.zeros((512, 512))
    k = capsule(24.0)
    h = k.shape[0] // 2
    image[256 - h : 257 + h, 256 - h : 257 + h] = k
    made = pyramid.integrate(laplacian(image), kernels)
    assert np.linalg.norm(made - image) / np.linalg.norm(image) < error
    assert mass < made.sum() <= 1.05


def test_membrane_keeps_known_pixels_nearly_and_constants_exactly():
    known = np.ones((60, 70))
    known[20:40, 20:50] = 0
    assert np.abs(pyramid.fill(np.full((1, 60, 70), 3.0), known) - 3).max() < 1e-6


def _random(turned: bool, seed: int = 0):
    rng = np.random.default_rng(seed)
    family = families.depth_speed(9.0, 14.0) if turned else families.depth(9.0)
    nodes = [0, family.size // 3, family.size - 1]
    made = [s for node in nodes for _, s in bake_node(family, node, Recipe())]
    points, n, (h, w) = Points.of(made), 200, (31, 43)
    angle = rng.uniform(0, 2 * np.pi, n)
    cosine = np.cos(angle) if turned else np.sign(np.cos(angle))
    light = (rng.random((n, 4)) * 10.0 ** rng.uniform(-3, 2, (n, 1))).astype(np.float32)
    sources = Sources(
        rng.integers(0, w, n).astype(np.int32),
        rng.integers(0, h, n).astype(np.int32),
        light,
        rng.integers(0, len(made), n).astype(np.uint32),
        cosine.astype(np.float32),
        np.sin(angle).astype(np.float32) if turned else None,
    )
    return Frame(h, w, guard_for(points, turned)), points, sources


@pytest.mark.parametrize("turned", [False, True])
def test_scatter_equals_its_twin(turned):
    frame, points, sources = _random(turned)
    fast, slow = splat(frame, points, sources), reference.splat(frame, points, sources)
    for a, b in ((fast.picture, slow.picture), (fast.charges, slow.charges)):
        assert np.abs(a - b).max() < 2e-5 * np.abs(b).max()


@pytest.mark.parametrize("turned", [False, True])
def test_integer_scatter_equals_its_twin_bit_for_bit_and_sums_to_zero(turned):
    frame, points, sources = _random(turned, 1)
    fast, slow = fixed.scatter(frame, points, sources), fixed.scatter_reference(frame, points, sources)
    assert np.array_equal(fast.picture, slow.picture) and np.array_equal(fast.charges, slow.charges)
    assert (fast.charges.sum((0, 1), dtype=np.int64) == 0).all()
    again = fixed.scatter(frame, points, sources)
    assert again.charges.tobytes() == fast.charges.tobytes()
    # Float quality: a step is 2⁻¹⁶ of white and a pixel gets at most a few hundred roundings.
    exact = reference.splat(frame, points, sources)
    assert np.abs(fast.charges * 2.0**-16 - exact.charges).max() < 2e-3 * max(1, np.abs(exact.charges).max())


def test_integer_range_is_held_and_counted():
    m, shift, cut = fixed.mantissas(np.array([[1e9, 1, 0, 1], [0.5, 0, 0, 1]], np.float32), np.array([1e-5, 1e-5]))
    assert cut == 1 and np.abs(m).max() <= 32767 and (shift >= 0).all() and (shift <= 29).all()
    assert np.abs(m[1]).max() >= 16384


@pytest.mark.parametrize("quarter", [0, 1, 2])
def test_turning_by_quarters_is_exact(quarter):
    s = lossless(capsule(4.0, 6.0))
    c, sn = [(1, 0), (0, 1), (-1, 0)][quarter]
    points = Points.of([s])
    one = Sources(np.array([20]), np.array([20]), np.ones((1, 4), np.float32), np.zeros(1, np.uint32),
                  np.array([c], np.float32), np.array([sn], np.float32))  # fmt: skip
    frame = Frame(41, 41, guard_for(points, True))
    made = frame.crop(splat(frame, points, one).charges[..., 0])
    expected = np.zeros((41, 41))
    expected[20 + s.y.astype(int), 20 + s.x.astype(int)] = s.values
    assert np.abs(made - np.rot90(expected, -quarter)).max() < 1e-6


def test_a_guard_one_pixel_short_is_wrong():
    s = lossless(capsule(8.0))
    points = Points.of([s])
    light = np.ones((32 * 32, 4), np.float32)
    y, x = np.mgrid[:32, :32].astype(np.int32)
    zero = np.zeros(1024, np.uint32)
    sources = Sources(x.ravel(), y.ravel(), light, zero, np.ones(1024, np.float32), None)
    frame = Frame(32, 32, guard_for(points, False))
    charges = splat(frame, points, sources).charges[..., 0].astype(float)
    full = frame.crop(solve.dst(charges))
    cut = charges.copy()
    reach = int(max(np.abs(s.x).max(), np.abs(s.y).max()))
    inner = slice(frame.guard - reach + 1, frame.guard + 32 + reach - 1)
    edge = np.ones_like(charges, bool)
    edge[inner, inner] = False
    cut[edge] = 0
    assert (
        np.abs(full - reference.dense(np.ones((32, 32, 1)), [capsule(8.0)], np.zeros((32, 32), int))[..., 0]).max()
        < 1e-3
    )
    assert np.abs(frame.crop(solve.dst(cut)) - full).max() > 1e-3


def test_dense_twin_is_a_convolution():
    image = np.zeros((21, 21, 1))
    image[10, 10] = 2.0
    k = capsule(3.0)
    made = reference.dense(image, [k], np.zeros((21, 21), int))[..., 0]
    h = k.shape[0] // 2
    assert np.allclose(made[10 - h : 11 + h, 10 - h : 11 + h], 2 * k)


def test_choice_of_nodes_is_unbiased():
    family = families.depth(20.0)
    y, x = (v.ravel().astype(np.int32) for v in np.mgrid[:256, :256])
    zeros = np.zeros(x.size, np.float32)
    for value in (0.7, 3.333, 11.1):
        node, clamped = choose(family, np.full(x.size, value, np.float32), zeros, zeros, x, y, frame=7)
        radii = np.array(family.radius.values)[node]
        step = np.ptp(radii)
        # Independent choices would have a standard error of step / 2 / √n; five of them.
        assert clamped == 0 and abs(radii.mean() - value) < 5 * step / 2 / np.sqrt(x.size)
    assert choose(family, np.full(4, 99.0), zeros[:4], zeros[:4], x[:4], y[:4])[1] == 4


def test_dither_differs_by_axis_and_frame():
    y, x = np.mgrid[:64, :64].astype(np.int32)
    values = [uniform(x, y, frame, axis).ravel() for frame in (0, 1) for axis in range(3)]
    assert all(0 <= v.min() and v.max() < 1 for v in values)
    correlation = np.corrcoef(values) - np.eye(len(values))
    assert np.abs(correlation[:3, :3]).max() < 0.05


def test_primal_needs_no_charges():
    s = primal(capsule(1.5))
    points = Points.of([s])
    one = Sources(np.array([8]), np.array([8]), np.ones((1, 4), np.float32), np.zeros(1, np.uint32),
                  np.ones(1, np.float32), None)  # fmt: skip
    planes = splat(Frame(17, 17, guard_for(points, False)), points, one)
    assert planes.charges is None and planes.picture[..., 0].sum() == pytest.approx(1, abs=1e-5)
