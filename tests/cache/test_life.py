"""Life of a cache: freeze, save, load, hostile files, changes, poison, views, errors."""

import tracemalloc

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, RadianceCache, settings_of
from lightwell.cache.change_detection import ChangeDetector
from lightwell.cache.frames import LAUNCH
from lightwell.cache.materials import material_table
from lightwell.cache.settings import VIEWS
from lightwell.cache.views import view

from .scenes import SMALL, room, sensor


@pytest.fixture(scope="module")
def trained():
    scene = room(32)
    nrc = NrcIntegrator(settings=settings_of({**SMALL, "mode": "frames"}))
    mi.render(scene, integrator=nrc, spp=6)
    return scene, nrc


def _picture(scene, nrc, seed=9):
    return np.array(mi.render(scene, integrator=nrc, spp=2, seed=seed))


def test_a_frozen_cache_stays_and_a_loaded_one_renders_the_same(trained, tmp_path):
    scene, nrc = trained
    nrc.cache.freeze()
    before = {k: np.array(v) for k, v in nrc.cache.predictor.learner.values.items()}
    picture = _picture(scene, nrc)
    assert all(np.array_equal(before[k], np.array(v)) for k, v in nrc.cache.predictor.learner.values.items())
    nrc.cache.save(tmp_path / "cache.npz")
    other = NrcIntegrator(settings=nrc.settings)
    other.cache = RadianceCache.load(tmp_path / "cache.npz", scene)
    other.cache.freeze()
    assert np.array_equal(picture, _picture(scene, other))
    nrc.cache.frozen = False


def test_files_that_do_not_fit_are_refused(trained, tmp_path):
    _, nrc = trained
    path = tmp_path / "cache.npz"
    nrc.cache.save(path)
    with pytest.raises(ValueError, match="learned on another scene"):
        RadianceCache.load(path, mi.load_dict(mi.cornell_box()))
    arrays = dict(np.load(path))
    for name, wrong, text in (
        ("value.w0", np.zeros((2, 2), np.float32), r"'value.w0' is \(2, 2\)"),
        ("value.w0", np.full_like(arrays["value.w0"], np.nan), "not finite"),
        ("box", np.zeros((2, 3)), "two corners"),
        ("about", np.frombuffer(b"{}", np.uint8), "not a radiance cache"),
    ):
        np.savez(tmp_path / "bad.npz", **{**arrays, name: wrong})
        with pytest.raises(ValueError, match=text):
            RadianceCache.load(tmp_path / "bad.npz")
    (tmp_path / "junk.npz").write_bytes(b"junk")
    with pytest.raises(ValueError, match="not a radiance cache"):
        RadianceCache.load(tmp_path / "junk.npz")


def test_every_view_is_a_finite_picture(trained):
    scene, nrc = trained
    for name in VIEWS:
        if name == "reservoir":
            continue
        shown = NrcIntegrator(settings=settings_of({**SMALL, "mode": "frames", "view": name}))
        shown.cache = nrc.cache
        image = np.array(mi.render(scene, integrator=shown, spp=1))
        assert image.shape[:2] == (32, 32) and np.isfinite(image).all()
        assert image.std() > 0 or name in ("dropped", "spread")


def test_poison_does_not_reach_the_weights(trained):
    _, nrc = trained
    cache = nrc.cache
    before = {k: np.array(v) for k, v in cache.predictor.learner.values.items()}
    from lightwell.cache.learner import Batch

    rows, inputs = cache.settings.training.batch, cache.predictor.model.direct_inputs
    full = lambda c, v: mi.TensorXf(np.full((rows, c), v, np.float32))  # noqa: E731
    cache.predictor.learner.train(Batch(full(inputs, 0.5), full(3, 0.5), full(3, np.nan), full(3, 1.0)), 0, 1e-2)
    assert all(np.array_equal(before[k], np.array(v)) for k, v in cache.predictor.learner.values.items())
    assert all(np.isfinite(np.array(v)).all() for v in cache.predictor.learner.average.values())


def test_the_detector_hears_a_switch_and_no_noise():
    rng, found = np.random.default_rng(0), 0
    detector = ChangeDetector()
    for _ in range(500):
        found += detector.update(float(np.exp(rng.normal(0, 0.5))), float(rng.normal(0, 0.05)))
    assert found <= 1
    for _ in range(40):
        detector.update(1.0 + 0.01 * rng.random(), float(rng.normal(0, 0.05)))
    assert any(detector.update(1.5, 0.9) for _ in range(4))


def test_a_lamp_that_goes_out_is_noticed_and_nothing_before():
    scene = room(64)
    nrc = NrcIntegrator(
        settings=settings_of({"mode": "frames", "levels": 3, "entries_log2": 10, "train_fraction_max": 0.3})
    )
    mi.render(scene, integrator=nrc, spp=60)
    assert nrc.cache.changes == 0
    parameters = mi.traverse(scene)
    parameters["lamp.emitter.radiance.value"] = 0.4
    parameters.update()
    mi.render(scene, integrator=nrc, spp=6)
    assert nrc.cache.changes >= 1


def test_bad_scenes_are_one_clear_line():
    nrc = lambda: NrcIntegrator(settings=settings_of(SMALL))  # noqa: E731
    dark = mi.load_dict({"type": "scene", "sensor": sensor(8), "ball": {"type": "sphere"}})
    with pytest.raises(ValueError, match="no emitter"):
        nrc().render(dark)
    away = mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(8, (0, 0, 5), (0, 0, 9)),
            "ball": {"type": "sphere", "radius": 0.5},
            "sky": {"type": "point", "position": [0, 3, 0]},
        }
    )
    with pytest.raises(ValueError, match="meets a surface"):
        nrc().render(away, spp=1)
    with pytest.raises(ValueError, match="box"):
        tent = mi.load_dict({"type": "scene", "s": sensor(8, rfilter="tent"), "sky": {"type": "constant"},
                             "b": {"type": "sphere"}})  # fmt: skip
        NrcIntegrator(settings=settings_of({**SMALL, "denoise": True})).render(tent)


def test_it_is_a_mitsuba_plugin():
    made = mi.load_string(
        '<scene version="3.0.0"><integrator type="lightwell_nrc"><float name="termination_c" value="0.02"/>'
        '<string name="preset" value="paper"/></integrator></scene>'
    ).integrator()
    assert isinstance(made, NrcIntegrator) and made.settings.paths.termination_c == pytest.approx(0.02)
    assert made.settings.network.layers == 5
    with pytest.raises(Exception, match="no parameter 'colour'"):
        mi.load_dict({"type": "lightwell_nrc", "colour": 3})


def test_a_cold_cache_learns_from_larger_frames_at_first():
    small = {"levels": 3, "entries_log2": 10, "batch": 128, "steps": 2, "mode": "frames", "on_change": "hint-only"}
    scene = room(64)
    nrc = NrcIntegrator(settings=settings_of({**small, "eager": 4}))
    shares = []
    for frames, expected in ((10, 8), (5, 4)):
        for _ in range(frames):
            shares.append(nrc.cache.schedule.unbiased_share if nrc.cache else 1.0)
            mi.render(scene, integrator=nrc, spp=1)
        steps = [t.steps for t in list(nrc.cache.history)[-frames:]]
        assert 2 < np.median(steps[:expected]) <= max(steps) <= 8 and all(n <= 2 for n in steps[expected:])
        nrc.scene_changed("light")
    assert [k for k, share in enumerate(shares) if share == 1] == [0, 1, 10, 11]
    plain = NrcIntegrator(settings=settings_of({**small, "eager": 1}))
    mi.render(scene, integrator=plain, spp=2)
    low = NrcIntegrator(settings=settings_of({**small, "budget": "low", "steps": 1}))
    mi.render(scene, integrator=low, spp=2)
    assert max(t.steps for t in plain.last.stats) <= 2 and max(t.steps for t in low.last.stats) == 1
    assert low.cache.schedule.unbiased_share == 1  # small frames: full paths for longer


def test_light_that_goes_is_noticed_in_two_frames_and_bright_records_are_not():
    rng = np.random.default_rng(3)
    seen = ChangeDetector()
    for k in range(200):
        assert not seen.update(1.0, float(rng.normal() * 0.018 - (0.5 if k % 37 == 36 else 0)))
    assert not seen.update(0.8, 0.5)
    assert seen.update(1.5, 0.18)
    for second, noticed in ((0.074, True), (0.01, False)):  # a cache that follows fast; one frame alone
        seen = ChangeDetector()
        for _ in range(200):
            assert not seen.update(1.0, float(rng.normal() * 0.012))
        assert not seen.update(0.8, 0.48) and seen.update(1.7, second) == noticed


def test_emitters_are_read_again_where_the_light_has_changed():
    lamps = {f"lamp {k}": {"type": "point", "position": [k, 0, 1], "intensity": 1.0} for k in range(3)}
    floor = {"type": "rectangle", "bsdf": {"type": "diffuse"}}
    scene = mi.load_dict({"type": "scene", "floor": floor, **lamps})
    cache = RadianceCache(settings_of(SMALL))
    cache.prepare(scene)
    lamps_seen = lambda: np.array(cache.region.context.emitters.table.place).reshape(3, 4)  # noqa: E731
    before, parameters = lamps_seen(), mi.traverse(scene)
    moved = next(key for key in parameters.keys() if key.endswith("position"))
    parameters[moved] = mi.Point3f(5, 6, 7)
    parameters.update()
    assert np.array_equal(lamps_seen(), before)
    cache.scene_changed("light", scene)
    changed = np.abs(lamps_seen() - before).max(axis=1) > 0
    assert changed.sum() == 1
    assert np.allclose(lamps_seen()[changed, :3], [5, 6, 7])


def test_materials_of_instances_are_in_the_table():
    metal = {"type": "roughconductor", "material": "none"}
    scene = mi.load_dict(
        {
            "type": "scene",
            "floor": {"type": "rectangle"},
            "group": {"type": "shapegroup", "ball": {"type": "sphere", "bsdf": metal}},
            "copy": {"type": "instance", "group": {"type": "ref", "id": "group"}},
            "sky": {"type": "constant"},
        }
    )
    # The floor reflects a half, the metal all but what its microfacets hide.
    assert material_table(scene).highest > 0.8


def test_views_of_many_samples_take_the_memory_of_a_launch(trained):
    scene, nrc = trained
    film, spp = mi.load_dict(sensor(8)), 8 * LAUNCH // 64
    tracemalloc.start()
    try:
        view(scene, film, nrc.cache, "albedo", spp, 0)
        assert tracemalloc.get_traced_memory()[1] < 4 * 12 * LAUNCH  # 12 bytes per sample, and copies
    finally:
        tracemalloc.stop()
