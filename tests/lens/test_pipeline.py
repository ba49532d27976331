"""The whole lens on arrays: energy, occlusion, highlights, bad pixels, sign, determinism."""

import numpy as np
import pytest

from lightwell import lens
from lightwell.lens import families, psf, reference
from lightwell.lens.aperture import from_picture, polygon
from lightwell.lens.camera import distance, from_thin_lens
from lightwell.lens.engine import Engine
from lightwell.lens.layers import Layer, composite, split, thresholds
from lightwell.lens.library import Library, load
from lightwell.lens.library_cache import STANDARD, LibraryCache
from lightwell.lens.pipeline import Lens
from lightwell.lens.recipes import Recipe
from lightwell.lens.report import Report
from lightwell.lens.settings import LensSettings


def camera_for(s_at: dict[float, float], width: int) -> lens.Camera:
    """A camera that gives one signed circle of confusion at one depth; focus 2."""
    ((depth, s),) = s_at.items()
    unit = lens.Camera(focus=2.0, fstop=1.0, focal=0.05)
    return lens.Camera(focus=2.0, fstop=float(unit.confusion(depth, width) / s), focal=0.05)


def run(rgba, depth, camera, motion=None, **settings):
    return Lens(LensSettings(**settings)).apply(np.asarray(rgba, np.float32), np.asarray(depth), motion, camera)


def test_confusion_is_that_of_a_thin_lens():
    # Rendered by Mitsuba: 8.73 / 2.89 / 2.95 / 5.76 / 7.92 px at these depths (focus 2, radius 0.05, F = 352).
    camera = from_thin_lens(352, 2 * np.rad2deg(np.arctan(0.5)), 0.05, 2.0)
    s = camera.confusion(np.array([1, 1.5, 3, 6, 20.0]), 352)
    assert np.abs(np.abs(s) - [8.79, 2.93, 2.93, 5.86, 7.91]).max() < 0.02
    assert s[0] < 0 < s[2] and camera.confusion(np.array([np.inf]), 352)[0] == pytest.approx(8.8, abs=0.02)


@pytest.mark.parametrize("text, metres", [("2.5m", 2.5), ("50mm", 0.05), ("1e2cm", 1.0), ("10ft", 3.048)])
def test_lengths_carry_units(text, metres):
    assert distance(text) == pytest.approx(metres)


def test_a_point_becomes_its_kernel_and_keeps_its_energy():
    size = 101
    rgba = np.zeros((size, size, 4), np.float32)
    rgba[50, 50] = [3, 2, 1, 1]
    layer = Layer(rgba, np.full((size, size), 12.0, np.float32), None)
    out = Lens(LensSettings(edges="dark", layers=1)).blur(layer, Report())
    assert out.sum((0, 1)) == pytest.approx([3, 2, 1, 1], rel=1e-3)
    kernel = psf.capsule(12.0)
    h = kernel.shape[0] // 2
    made = out[50 - h : 51 + h, 50 - h : 51 + h, 0] / 3
    assert np.linalg.norm(made - kernel) < 0.25 * np.linalg.norm(kernel)


def test_constant_stays_constant():
    rgba = np.full((80, 90, 4), 0.5)
    rgba[..., 3] = 1
    x = np.mgrid[:80, :90][1]
    out, _ = run(rgba, 3.0 + x / 90, camera_for({5.0: 9.0}, 90), layers=1)
    assert np.abs(out[..., :3] - 0.5).max() < 1e-4 and np.abs(out[..., 3] - 1).max() < 1e-4


def test_linear_and_shift_invariant():
    rng = np.random.default_rng(0)
    a, b = rng.random((2, 64, 64, 4)).astype(np.float32)
    depth = np.full((64, 64), 5.0)
    options = {"edges": "dark", "layers": 1, "tolerance": np.inf}
    engine = Lens(LensSettings(**options))
    s = np.full((64, 64), 6.0, np.float32)

    def blur(image, s=s):
        return engine.blur(Layer(image.astype(np.float32), s, None), Report())

    assert np.abs(blur(a + 2 * b) - blur(a) - 2 * blur(b)).max() < 2e-5
    inner = np.zeros((64, 64, 4))
    inner[20:40, 20:40] = a[:20, :20]
    nodes = np.full((64, 64), float(families.depth(64).radius.values[60]), np.float32)
    moved = np.roll(blur(inner, nodes), (3, 5), (0, 1))
    assert np.abs(blur(np.roll(inner, (3, 5), (0, 1)), nodes) - moved).max() < 1e-5
    assert depth.shape == (64, 64)


def test_sparse_against_dense_on_a_ramp_reaches_50_db_with_few_points():
    size = 160
    y, x = np.mgrid[:size, :size]
    rgb = 0.2 + 0.6 * (((x // 12) + (y // 12)) % 2)[..., None] * np.array([1, 0.8, 0.5])
    rgba = np.concatenate([rgb, np.ones((size, size, 1))], -1).astype(np.float32)
    family = families.depth(64)
    radii = np.array(family.radius.values)
    node = np.abs(radii[None] - (x[0] / size * 16)[:, None]).argmin(1)
    s = np.broadcast_to(radii[node].astype(np.float32), (size, size))
    report = Report()
    made = Lens(LensSettings(edges="dark", layers=1)).blur(Layer(rgba, s, None), report)
    which = np.broadcast_to(node, (size, size))
    kernels = {int(n): family.kernel(int(n)) for n in np.unique(node)}
    exact = reference.dense(rgba.astype(float), [kernels.get(i, np.ones((1, 1))) for i in range(node.max() + 1)], which)
    error = np.mean((np.clip(made[..., :3], 0, 1) - np.clip(exact[..., :3], 0, 1)) ** 2)
    assert -10 * np.log10(error) > 50 and report.points < 0.45 * report.dense


def test_foreground_spills_as_the_closed_form_says():
    width, r = 160, 16.0
    depth = np.where(np.arange(width) < 80, 1.0, 2.0) * np.ones((64, 1))
    rgba = np.zeros((64, width, 4))
    rgba[..., 3] = 1
    rgba[:, :80, 0], rgba[:, 80:, 1] = 1, 1
    out, _ = run(rgba, depth, camera_for({1.0: -r}, width))
    d = np.arange(80, 80 + 16) + 0.5 - 80
    q = np.clip(d / r, -1, 1)
    alpha = (np.arccos(q) - q * np.sqrt(1 - q**2)) / np.pi
    row = out[32, 80:96]
    assert np.abs(row[:, 0] - alpha).max() < 0.02, "red of the foreground"
    assert np.abs(row[:, 1] - (1 - alpha)).max() < 0.02, "green of the background, undimmed"


def test_background_does_not_bleed_onto_a_sharp_foreground():
    y, x = np.mgrid[:120, :120]
    disc = (x - 60) ** 2 + (y - 60) ** 2 < 30**2
    rgba = np.zeros((120, 120, 4))
    rgba[..., 3] = 1
    rgba[~disc, :3] = 5
    out, _ = run(rgba, np.where(disc, 2.0, 50.0), camera_for({50.0: 14.0}, 120))
    inside = (x - 60) ** 2 + (y - 60) ** 2 < 28**2
    assert out[inside][:, :3].max() < 5e-3
    outside = (x - 60) ** 2 + (y - 60) ** 2 > 32**2
    assert out[outside][:, :3].min() > 4.9, "the background goes on behind, without a dark rim"


def test_asymmetric_aperture_flips_in_front_of_focus():
    mask = np.zeros((32, 32))
    mask[:16] = 1
    mask[16:28, 4:14] = 1
    shape = from_picture(mask)
    rgba, size = np.zeros((81, 81, 4)), 81
    rgba[40, 40] = 1
    behind, front = (
        run(rgba, np.full((size, size), z), camera_for({z: s}, size), aperture=shape, edges="dark", layers=1)[0]
        for z, s in ((5.0, 10.0), (1.2, -10.0))
    )
    assert np.abs(behind - front[::-1, ::-1]).max() < 1e-5 and np.abs(behind - front).max() > 1e-3


def test_zero_motion_is_depth_only():
    rng = np.random.default_rng(1)
    rgba = rng.random((50, 60, 4)).astype(np.float32)
    s = np.full((50, 60), 8.0, np.float32)
    flat = Engine(families.depth(8.0), Recipe(), LibraryCache(keep=False), tolerance=0)
    joint = Engine(families.depth_speed(8.0, 4.0), Recipe(), LibraryCache(keep=False), tolerance=0)
    a = flat.blur(Layer(rgba, s, None), Report())
    b = joint.blur(Layer(rgba, s, np.zeros((50, 60, 2), np.float32)), Report())
    assert np.abs(a - b).max() < 2e-4


def test_motion_streaks_along_its_direction():
    rgba, depth = np.zeros((81, 81, 4)), np.full((81, 81), 2.0)
    rgba[40, 40] = 1
    motion = np.zeros((81, 81, 2), np.float32)
    motion[..., 0], motion[..., 1] = 24, 24
    camera = lens.Camera(focus=2.0, fstop=2.8, focal=0.05, shutter=1.0)
    out, report = run(rgba, depth, camera, motion, edges="dark", layers=1)
    y, x = np.mgrid[:81, :81] - 40.0
    light = out[..., 0] / out[..., 0].sum()
    along, across = (x + y) / np.sqrt(2), (x - y) / np.sqrt(2)
    assert (light * along**2).sum() > 20 * (light * across**2).sum()
    assert (light * along**2).sum() == pytest.approx(24**2 * 2 / 12, rel=0.1) and report.longest > 33


def test_bad_pixels_are_contained():
    rgba, depth = np.full((60, 60, 4), 0.5, np.float32), np.full((60, 60), 5.0)
    rgba[..., 3] = 1
    clean, _ = run(rgba, depth, camera_for({5.0: 6.0}, 60))
    rgba[20, 20, 1], rgba[21, 30, 0], depth[40, 40], depth[41, 40], depth[42, 40] = np.nan, np.inf, np.nan, -1, 0
    out, report = run(rgba, depth, camera_for({5.0: 6.0}, 60))
    assert report.bad == 5 and np.isfinite(out).all() and np.abs(out - clean).max() < 1e-3


def test_an_extreme_highlight_stays_within_its_kernel():
    rgba = np.full((100, 100, 4), 0.2, np.float32)
    rgba[..., 3] = 1
    rgba[50, 50, :3] = 1e6
    out, _ = run(rgba, np.full((100, 100), 5.0), camera_for({5.0: 10.0}, 100), layers=1)
    y, x = np.mgrid[:100, :100] - 50
    far = x**2 + y**2 > 12**2
    assert np.abs(out[far][:, :3] - 0.2).max() < 0.01 and out[50, 50, 0] > 1000


def test_sky_at_infinity_is_blurred():
    rgba = np.zeros((61, 61, 4))
    rgba[30, 30] = 1
    out, report = run(rgba, np.full((61, 61), np.inf), camera_for({1e9: 7.0}, 61), edges="dark")
    assert report.bad == 0 and (out[..., 0] > 1e-3).sum() > 100


def test_alpha_is_blurred_coverage():
    rgba = np.zeros((80, 80, 4))
    rgba[20:60, 20:60] = [0.5, 0.25, 0, 0.5]
    out, _ = run(rgba, np.full((80, 80), 5.0), camera_for({5.0: 6.0}, 80), layers=1)
    assert out[40, 40] == pytest.approx([0.5, 0.25, 0, 0.5], abs=1e-2)
    assert 0.15 < out[40, 20, 3] < 0.35 and out[0, 0, 3] < 1e-3


def test_same_bytes_in_integer_mode():
    rng = np.random.default_rng(2)
    rgba = np.concatenate([rng.random((40, 50, 3)), np.ones((40, 50, 1))], -1)
    depth = 1.2 + 4 * rng.random((40, 50))
    motion = rng.normal(size=(40, 50, 2)).astype(np.float32) * 4
    camera = lens.Camera(focus=2.0, fstop=2.0, focal=0.05)
    a, b = (run(rgba, depth, camera, motion, deterministic=True)[0] for _ in range(2))
    assert a.tobytes() == b.tobytes()
    assert np.abs(a - run(rgba, depth, camera, motion)[0]).max() < 5e-3


def test_clamped_blur_is_counted():
    out, report = run(np.ones((20, 30, 4)), np.full((20, 30), 0.3), camera_for({1.0: -20.0}, 30))
    assert report.clamped == 600 and np.isfinite(out).all()


def test_motion_longer_than_the_frame_is_cut_and_counted():
    motion = np.full((40, 40, 2), 500.0, np.float32)
    camera = lens.Camera(focus=2.0, fstop=8.0, focal=0.05, shutter=1.0)
    out, report = run(np.ones((40, 40, 4)), np.full((40, 40), 2.0), camera, motion)
    assert report.clamped == 1600 and np.isfinite(out).all()


@pytest.mark.parametrize("edges", ["extend", "renormalise"])
def test_frame_edges_are_not_dark(edges):
    rgba = np.ones((60, 60, 4))
    out, _ = run(rgba, np.full((60, 60), 5.0), camera_for({5.0: 10.0}, 60), edges=edges)
    assert np.abs(out[..., :3] - 1).max() < 5e-3
    dark, _ = run(rgba, np.full((60, 60), 5.0), camera_for({5.0: 10.0}, 60), edges="dark")
    assert dark[0, 30, 0] < 0.7


def test_a_given_layer_behind_is_seen_around_the_front():
    depth = np.where(np.arange(100) < 50, 1.0, 2.0) * np.ones((40, 1))
    front = np.zeros((40, 100, 4))
    front[:, :50] = [1, 0, 0, 1]
    behind = np.zeros((40, 100, 4))
    behind[:] = [0, 0, 1, 1]
    camera = camera_for({1.0: -10.0}, 100)
    depth = np.where(front[..., 3] > 0, depth, np.inf)
    out, report = Lens(LensSettings()).apply(front, depth, None, camera, behind=[(behind, np.full((40, 100), 2.0))])
    assert report.layers == 2 and out[20, 50, 2] == pytest.approx(0.5, abs=0.06) and out[20, 95, 2] > 0.99


def test_structure_goes_on_behind_a_thin_front():
    stripes = np.where((np.arange(64) // 8) % 2, 1.0, 0.1)[:, None] * np.ones((64, 96))
    bar = (np.abs(np.arange(96) - 48) < 3) * np.ones((64, 1), bool)
    rgba = np.ones((64, 96, 4), np.float32)
    rgba[..., :3] = np.where(bar, 0.5, stripes)[..., None]
    s = np.where(bar, -9.0, 0.0).astype(np.float32)
    behind = split(rgba, s, None, 2, 20.0)[-1].rgba
    # A smooth fill would be off by 0.2 next to the stripes' borders.
    assert np.abs(behind[..., 0] - stripes)[bar].max() < 0.02


def test_what_hides_behind_the_front_is_of_the_layer_seen_nearest():
    s = np.zeros((80, 40), np.float32)
    s[:, 20:] = 8
    s[:40, 10:30] = -8
    rgba = np.where(s[..., None] == -8, [0.2, 0.2, 0.2, 1], np.where(s[..., None] == 0, [1, 0, 0, 1], [0, 0, 1, 1]))
    _, middle, back = split(rgba.astype(np.float32), s, None, 3, 30.0)
    assert middle.rgba[12, :20, 3] == pytest.approx(1) and middle.rgba[12, 21:, 3] == pytest.approx(0)
    assert back.rgba[12, 10:, 2] == pytest.approx(1)


def test_layers_are_cut_at_edges_not_through_surfaces():
    x = np.mgrid[:60, :80][1]
    s = np.where(x < 40, -10.0, 6.0 + 0.01 * x)
    (cut,) = thresholds(s, 2)
    assert -10 < cut < 6
    assert thresholds(0.05 * x + 0.0, 2) == [], "a slanted plane stays whole"


def test_compositing_front_to_back():
    front, back = np.zeros((1, 1, 4)), np.array([[[0.0, 1.0, 0.0, 1.0]]])
    front[0, 0] = [0.25, 0, 0, 0.25]
    assert composite([front, back])[0, 0] == pytest.approx([0.25, 0.75, 0, 1])


def test_cats_eye_runs_and_keeps_energy():
    rgba = np.zeros((101, 101, 4))
    rgba[20, 20] = 1
    out, _ = run(rgba, np.full((101, 101), 5.0), camera_for({5.0: 10.0}, 101), cats_eye=1.0, edges="dark", layers=1)
    assert out[..., 0].sum() == pytest.approx(1, abs=5e-3)
    light = out[..., 0] / out[..., 0].sum()
    y, x = np.mgrid[:101, :101].astype(float)
    x, y = x - (light * x).sum(), y - (light * y).sum()
    towards = (light * ((x + y) / np.sqrt(2)) ** 2).sum()
    across = (light * ((x - y) / np.sqrt(2)) ** 2).sum()
    assert towards < 0.75 * across, "narrow along the field's radius"


def test_cats_eye_does_not_depend_on_what_is_guessed_outside_the_frame():
    rgba = np.zeros((101, 101, 4))
    rgba[..., 3] = 1
    rgba[20, 20, :3] = 1
    same = {"cats_eye": 1.0, "layers": 1, "choice": "nearest"}
    camera = camera_for({5.0: 10.0}, 101)
    found = [run(rgba, np.full((101, 101), 5.0), camera, edges=edges, **same) for edges in ("dark", "extend")]
    dark, extended = (out[8:33, 8:33, 0] for out, _ in found)
    assert np.abs(extended - dark).max() < 0.02 * dark.max()
    assert found[1][1].clamped == 0


def test_frames_before_the_first_have_numbers_too():
    rgba = np.full((24, 24, 4), 0.5, np.float32)
    motion = np.full((24, 24, 2), 3.0, np.float32)
    settings = LensSettings(layers=1)
    out, _ = Lens(settings).apply(rgba, np.full((24, 24), 5.0), motion, camera_for({5.0: 2.0}, 24), frame_number=-7)
    assert np.isfinite(out).all()


def test_polygon_with_motion_uses_the_baked_angle():
    rgba = np.zeros((61, 61, 4))
    rgba[30, 30] = 1
    motion = np.zeros((61, 61, 2), np.float32)
    motion[..., 1] = 16
    camera = camera_for({5.0: 6.0}, 61)
    camera = lens.Camera(focus=camera.focus, fstop=camera.fstop, focal=camera.focal, shutter=1.0)
    out, _ = run(rgba, np.full((61, 61), 5.0), camera, motion, aperture=polygon(6), edges="dark", layers=1)
    y, x = np.mgrid[:61, :61] - 30.0
    assert (out[..., 0] * y**2).sum() > 2.5 * (out[..., 0] * x**2).sum()
    assert out[..., 0].sum() == pytest.approx(1, abs=0.03)


def test_the_standard_libraries_are_what_the_code_asks_for():
    for family in (families.depth(64),):
        key = Library(family, LensSettings().recipe()).key()
        found = load(STANDARD / f"{key}.lwsp")
        assert found.key() == key and len({k[0] for k in found.nodes}) == family.size
    page = load(STANDARD / "disc-32.lwsp")
    assert page.family.name == "depth" and max(page.family.radius.values) == 32.0


def test_bands_are_the_whole_frame():
    rng = np.random.default_rng(5)
    rgba = rng.random((120, 40, 4)).astype(np.float32)
    rgba[..., 3] = 1
    depth = np.full((120, 40), 10.0)
    depth[:, 20:] = np.linspace(3, 12, 120)[:, None]
    camera = lens.Camera(focus=5.0, fstop=0.05, focal=0.05)
    settings = [LensSettings(layers=1, most_pixels=most) for most in (1 << 22, 1200)]
    found = [Lens(one).apply(rgba, depth, None, camera) for one in settings]
    assert 1 < found[0][1].largest < 8
    # Sparse kernels leak far beyond their radius, by parts of a thousand.
    np.testing.assert_allclose(found[1][0], found[0][0], atol=5e-3)
    assert np.abs(found[1][0] - found[0][0]).mean() < 2e-4
