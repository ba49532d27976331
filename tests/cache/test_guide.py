"""The guide: its table, its densities, and that pictures keep their mean whatever it holds."""

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.cache import NrcIntegrator, RadianceCache, settings_of
from lightwell.cache.guide import BINS, FACES, SIDE, Guide, GuidedVertex, bin_of, direction_of, key_of
from lightwell.cache.guide_table import LONGEST, GuideTable, on_device, tree_of

from .scenes import SMALL, furnace, room

UNIT = np.array([[0.0, 0, 0], [1, 1, 1]])


def wild(rows: int, seed: int = 0) -> np.ndarray:
    """Distributions that no scene has: a few high bins, all others low."""
    p = np.random.default_rng(seed).gamma(0.2, size=(rows, BINS)) + 1e-3
    return p / p.sum(1, keepdims=True)


def made(p: np.ndarray, rows: np.ndarray | None = None, cells=(2.0, 3, 4), share=0.5) -> Guide:
    count = int(np.prod(cells)) * FACES
    rows = np.arange(count) % len(p) if rows is None else rows
    level = np.random.default_rng(1).gamma(1.0, size=len(p))
    return on_device(rows, p, level, mi.Vector3f(*cells), share)


def test_bins_hold_their_directions_and_cover_the_sphere():
    u, v = np.random.default_rng(3).random((2, 4096)).astype(np.float32)
    d = direction_of(mi.Float(u), mi.Float(v))
    assert np.allclose(np.array(dr.norm(d)), 1, atol=1e-5)
    bins = np.array(bin_of(d))
    expected = (v * SIDE).astype(int) * SIDE + (u * SIDE).astype(int)
    assert (bins == expected).mean() > 0.999  # the rest lies on borders
    poles = bin_of(mi.Vector3f([0, 0, -1], [0, 0, -1e-9], [1, -1, 0]))
    assert np.array(poles).max() < BINS


def test_cells_are_told_apart_by_place_and_by_the_side_that_they_face():
    cells = mi.Vector3f(2, 3, 4)
    p = np.array([[0.1, 0.1, 0.1], [1.9, 2.9, 3.9], [-5, 1.5, 99], [0.1, 0.1, 0.1]])
    n = np.array([[1, 0, 0], [0, 0, -1], [0.1, -0.9, 0.2], [-0.8, 0.6, 0]])
    keys = np.array(key_of(mi.Vector3f(p.T.astype(np.float32)), mi.Vector3f(n.T.astype(np.float32)), cells))
    assert list(keys) == [0, 23 * FACES + 5, ((3 * 3 + 1) * 2 + 0) * FACES + 3, 1]


def test_the_density_integrates_to_one_and_samples_follow_it():
    p, count = wild(3), 1 << 17
    guide = made(p)
    density = np.array(guide.density).reshape(3, BINS)
    assert np.allclose(density.sum(1) * 4 * np.pi / BINS, 1, rtol=1e-5)
    assert np.allclose(tree_of(p).sum(2), 1, atol=1e-6)
    for row in range(3):
        sampler = mi.PCG32(count, initstate=row)
        u = mi.Point2f(sampler.next_float32(), sampler.next_float32())
        at = dr.full(mi.UInt32, row, count)
        d, pdf = guide.sample(at, u, mi.Bool(True))
        again = np.array(guide.pdf(at, d, mi.Bool(True)))
        assert np.isclose(np.array(pdf), again, rtol=1e-3).mean() > 0.999  # borders of bins
        found = np.bincount(np.array(bin_of(d)), minlength=BINS)
        chi2 = ((found - count * p[row]) ** 2 / (count * p[row])).sum()
        assert chi2 < BINS + 5 * np.sqrt(2 * BINS)
    u = mi.Point2f([0, 1 - 2**-24], [1 - 2**-24, 0])
    d, pdf = guide.sample(dr.zeros(mi.UInt32, 2), u, mi.Bool(True))
    assert np.isfinite(np.array(d)).all() and (np.array(pdf) > 0).all()


def records(keys, bins, met, reach, whole):
    return (np.array(keys, np.uint32), np.array(bins, np.float32), np.array(met, np.float32),
            np.array(reach, np.float32), np.array(whole, np.float32))  # fmt: skip


def test_the_table_learns_directions_and_cells_without_records_ask_the_box_around_them():
    table = GuideTable(UNIT, 0.5, 4)
    assert list(table.cells) == [4, 4, 4] and LONGEST >= 4
    for _ in range(20):
        table.add(*records([7] * 100, [9] * 100, [2.0] * 100, [0.0] * 100, [3.0] * 100))
    rows, p, level = table.table()
    assert rows[7] > 0 and p[rows[7], 9] > 0.9 and abs(level[rows[7]] - 3) < 1e-6
    assert 0 < rows[FACES * 63 + 1] < rows[7] and p[rows[FACES * 63 + 1], 9] > 0.9  # the other end, same side
    assert rows[8] == 0 and np.allclose(p[0], 1 / BINS)  # no record faces that way
    table.forget()
    for _ in range(3):
        table.add(*records([7] * 100, [200] * 100, [2.0] * 100, [0.0] * 100, [3.0] * 100))
    _, p, _ = table.table()
    assert p[rows[7], 200] > 0.5


def test_what_lies_behind_is_read_from_the_mean_of_its_cell():
    table = GuideTable(UNIT, 0.5, 4)
    rng = np.random.default_rng(0)
    for _ in range(30):  # pairs of records: cell 0 looks into cell 1, which is noisy with mean 4
        whole = np.stack([np.full(500, 2.0), rng.exponential(4, 500)], 1).ravel()
        table.add(*records([0, 6] * 500, [3, 5] * 500, [0.0, 1.0] * 500, [0.5, 0.0] * 500, whole))
    row = table.row_of[0]
    assert abs(table.sums[row, 1] / table.sums[row, 0] / (0.5 * 4) - 1) < 0.1
    effective = table.sums[row, 1] ** 2 / table.sums[row, 2]
    assert effective > 0.95 * table.sums[row, 0]  # hardly any noise of the second record is left


def test_bad_records_are_left_out_and_no_record_is_no_table():
    table = GuideTable(UNIT, 0.5, 4)
    rows, p, level = table.table()
    assert not rows.any() and p.shape == (1, BINS) and level[0] == 0
    bad = records([1, 2, 10**6, 3], [np.nan, -1, 4, 5], [1, 1, 1, np.inf], [0, 0, 0, 0], [1, 1, 1, 1])
    table.add(*bad)
    assert not len(table.keys)


def integrator(**options):
    return NrcIntegrator(settings=settings_of({**SMALL, "estimator": "guided", **options}))


def guided(scene, trained: int, seed: int = 0) -> RadianceCache:
    """A frozen cache whose guide is trained, or nonsense."""
    nrc = integrator(mode="frames")
    cache = nrc.cache_of(scene)
    if trained:
        with dr.suspend_grad():
            for _ in range(trained):
                cache.train_frame(scene, scene.sensors()[0], seed)
    else:
        table, rng = cache.guiding.table, np.random.default_rng(seed)
        keys = rng.permutation(len(table.row_of))[: len(table.row_of) // 2]
        sums = np.ones((len(keys), 5)) * 1000
        sums[:, 3] *= rng.gamma(0.5, size=len(keys))
        table.restore(keys, wild(len(keys)) * 1000, sums, 1)
    cache.freeze()
    return cache


def z_of_means(scene, cache: RadianceCache, repeats: int = 16) -> float:
    path = mi.load_dict({"type": "path", "max_depth": -1})
    ours, theirs = [], []
    for seed in range(repeats):
        nrc = integrator(mode="frames")
        nrc.cache = cache
        ours.append(np.array(mi.render(scene, integrator=nrc, spp=128, seed=seed)).mean())
        theirs.append(np.array(mi.render(scene, integrator=path, spp=128, seed=1000 + seed)).mean())
    spread = np.sqrt((np.var(ours, ddof=1) + np.var(theirs, ddof=1)) / repeats)
    return float((np.mean(ours) - np.mean(theirs)) / spread)


GLOSSY = {"type": "roughconductor", "alpha": 0.2}
COATED = {"type": "plastic", "diffuse_reflectance": {"type": "rgb", "value": [0.2, 0.6, 0.3]}}
GLASS = {"type": "roughdielectric", "alpha": 0.3}


@pytest.mark.parametrize(
    ("bsdf", "trained"),
    [(GLASS, 0), *(pytest.param(*one, marks=pytest.mark.slow) for one in ((GLOSSY, 6), (GLOSSY, 0), (COATED, 0)))],
)
def test_the_mean_is_the_path_tracer_s_whatever_the_guide_holds(bsdf, trained):
    scene = room(16, bsdf)
    assert abs(z_of_means(scene, guided(scene, trained))) < 2.6


def test_a_wrong_density_is_found(monkeypatch):
    scene = room(16)
    right = Guide.pdf
    monkeypatch.setattr(Guide, "pdf", lambda self, row, d, active: 1.2 * right(self, row, d, active))
    assert abs(z_of_means(scene, guided(scene, 0), 8)) > 4


def test_furnace_with_a_guide():
    scene = furnace((0.5, 0.2, 0.0))
    for trained in (0, 4):
        nrc = integrator(mode="frames")
        nrc.cache = guided(scene, trained)
        image = np.array(mi.render(scene, integrator=nrc, spp=64))
        assert np.allclose(image.mean(axis=(0, 1)), 1 / (1 - np.array([0.5, 0.2, 0])), rtol=0.01)


def test_a_calm_still_is_path_traced_and_a_cache_can_have_a_guide_too():
    scene = furnace()
    nrc = integrator(mode="still", warmup=4)
    mi.render(scene, integrator=nrc, spp=8)
    assert not nrc.last.guiding and len(nrc.last.stats) == 1
    nrc = NrcIntegrator(settings=settings_of({**SMALL, "guide": True, "mode": "still", "warmup": 20}))
    image = np.array(mi.render(scene, integrator=nrc, spp=16))
    assert nrc.cache.guiding.guide is not None and np.allclose(image.mean(axis=(0, 1)), 2, rtol=0.03)


def test_the_guide_is_saved_and_hostile_ones_are_refused(tmp_path):
    scene = room()
    cache = guided(scene, 3)
    path = tmp_path / "guided.npz"
    cache.save(path)
    again = RadianceCache.load(path, scene)
    for a, b in zip(cache.guiding.table.table(), again.guiding.table.table()):
        assert np.allclose(a, b, rtol=1e-5)
    again.prepare(scene)
    again.freeze()
    pictures = []
    for held in (cache, again):
        nrc = integrator(mode="frames")
        nrc.cache = held
        held.guiding.table.made = None
        pictures.append(np.array(mi.render(scene, integrator=nrc, spp=4)))
    assert np.allclose(*pictures, rtol=1e-2, atol=1e-3)
    with np.load(path) as held:
        arrays = dict(held)
    keys, sums = arrays["guide.keys"], arrays["guide.sums"]
    for name, wrong in (
        ("keys", keys + 10**7), ("keys", np.zeros_like(keys)), ("keys", keys[0]), ("keys", -keys), ("sums", sums[:-1]),
        ("sums", -sums), ("sums", sums * np.nan), ("bins", arrays["guide.bins"].astype(np.float64)),
        ("frames", np.array([1.0])),
    ):  # fmt: skip
        np.savez(tmp_path / "bad.npz", **{**arrays, f"guide.{name}": wrong})
        with pytest.raises(ValueError, match="guide"):
            RadianceCache.load(tmp_path / "bad.npz")


def test_no_path_is_endless_where_the_guide_knows_nothing():
    mirror = GuidedVertex(mi.UInt32(0), mi.Float(0), mi.Float(0), mi.Float(0.5), mi.Bool(False))
    alive = [float(mirror.survival(mi.Spectrum(1), mi.Float(0), mi.UInt32(depth))[0][0]) for depth in (1, 1000)]
    assert alive[0] == 1 and 0 < alive[1] < 1
