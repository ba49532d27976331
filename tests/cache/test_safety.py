"""Bad input and bad luck: each is one clear line, or is survived."""

import warnings

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.cache import NrcIntegrator, RadianceCache, settings_of
from lightwell.cache.change_detection import SPAN, DivergenceMonitor
from lightwell.cache.checks import check_sensor, check_variant
from lightwell.cache.replay import CAPACITY, PER_CAMERA, Replay
from lightwell.cache.schedule import YOUNG, YOUNG_STEPS, FrameSchedule

from .scenes import T, furnace, room, sensor

SMALL = {"levels": 3, "entries_log2": 10, "batch": 512, "steps": 2, "train_fraction_max": 1.0, "max_vertices": 6}


@pytest.mark.parametrize(
    "variant",
    ["scalar_rgb", "llvm_ad_mono", "llvm_ad_spectral", "llvm_ad_rgb_polarized", "llvm_ad_spectral_polarized", None],
)
def test_other_variants_are_refused_with_the_cure(variant):
    with pytest.raises(ValueError, match=rf"variant is '{variant or 'none'}', lightwell_nrc needs llvm_ad_rgb"):
        check_variant(variant)


def test_a_film_without_pixels_is_refused():
    class Film:
        def crop_size(self):
            return 0, 24

    class Sensor:
        def film(self):
            return Film()

    with pytest.raises(ValueError, match="the film is 0 x 24 pixels"):
        check_sensor(Sensor())


def test_a_bsdf_of_nan_is_found_in_a_real_scene():
    bad = {"type": "diffuse", "reflectance": {"type": "bitmap", "raw": True, "filter_type": "nearest",
           "bitmap": mi.Bitmap(np.full((2, 2, 3), np.nan, np.float32))}}  # fmt: skip
    with pytest.raises(ValueError, match=r"of the values of material '.+' are not finite; correct"):
        RadianceCache(settings_of(SMALL)).prepare(room(8, bsdf=bad))


def test_records_that_are_no_numbers_are_dropped_and_counted():
    scene = room(24)
    nrc = NrcIntegrator(settings=settings_of({**SMALL, "mode": "frames"}))
    mi.render(scene, integrator=nrc, spp=2)
    parameters = mi.traverse(scene)
    parameters["lamp.emitter.radiance.value"] = mi.Color3f(np.nan)
    parameters.update()
    before = {k: np.array(v) for k, v in nrc.cache.predictor.learner.values.items()}
    mi.render(scene, integrator=nrc, spp=2)
    assert nrc.last.stats[-1].dropped > 0
    assert all(np.isfinite(np.array(v)).all() for v in nrc.cache.predictor.learner.values.values()) and before
    parameters["lamp.emitter.radiance.value"] = mi.Color3f(8.0)
    parameters.update()
    image = np.array(mi.render(scene, integrator=nrc, spp=2))
    assert np.isfinite(image).all() and image.mean() > 0


def test_growth_without_cause_is_noticed_and_noise_is_not():
    watch, rng = DivergenceMonitor(), np.random.default_rng(0)
    assert not any(watch.update(float(1 + 0.2 * rng.normal())) for _ in range(500))
    assert any(watch.update(1.02**k) > 1.5 for k in range(2 * SPAN))


def test_a_cache_that_feeds_on_itself_advises_attenuation():
    scene = furnace((0.5, 0.5, 0.5))
    cache = RadianceCache(settings_of(SMALL))
    cache.prepare(scene)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        for k in range(SPAN + 1):
            cache.trainer.watch_growth(1.03**k)
        cache.schedule.since_change = YOUNG
        cache.predictor.learner.averaged = YOUNG_STEPS - 1
        for k in range(SPAN + 1):
            cache.trainer.watch_growth(1.03**k)
        assert not heard  # A young cache learns the light of many bounces; frames of small pictures have few steps.
        cache.predictor.learner.averaged = YOUNG_STEPS
        for k in range(SPAN + 1):
            cache.trainer.watch_growth(1.03**k)
    assert any("set tail_attenuation" in str(w.message) for w in heard)


def test_rays_of_earlier_cameras_are_kept_and_traced_again():
    pool = Replay()
    for camera in range(12):
        pool.look(str(camera))
        pool.saw(mi.Point3f(np.full((3, 700), camera, np.float32)), mi.Vector3f(np.ones((3, 700), np.float32)))
    assert pool.held == CAPACITY and set(np.array(pool.pool[0])[0]) <= set(range(11))
    pool.look("11")
    assert pool.held == CAPACITY  # the camera rests: nothing is added
    scene = room(32)
    nrc = NrcIntegrator(settings=settings_of({**SMALL, "mode": "frames", "replay": 0.5}))
    mi.render(scene, integrator=nrc, spp=3)
    assert nrc.cache.trainer.replay.held == 0
    parameters = mi.traverse(scene)
    key = next(k for k in parameters.keys() if k.endswith("to_world") and "sensor" in k)
    turned = T().look_at(origin=[0, 0, 0.9], target=[0, 0, -1], up=[0, 1, 0])
    parameters[key] = mi.Transform4f(turned.matrix)
    parameters.update()
    mi.render(scene, integrator=nrc, spp=1)
    assert nrc.cache.trainer.replay.held == min(PER_CAMERA, nrc.cache.history[-2].paths)
    # Half of the rays start where the first camera stood, the others at the new one.
    starts = np.array(nrc.cache.trainer.replay.state()[1]["last_o"])[2]
    assert 0.25 < (starts < 0).mean() < 0.75 and (starts > 0).any()


@pytest.mark.parametrize("seconds", [0.0, 10.0])
def test_the_first_frames_before_a_still_with_a_time_limit_are_small(seconds):
    # They find out whether training pays; where it does not, what they took is lost.
    schedule, paths = FrameSchedule(settings_of({"mode": "still", "seconds": seconds})), []
    schedule.still = True
    for _ in range(3):
        columns, rows, *_ = schedule.tiles_of(256, 256).grid(256, 256)
        paths.append(columns * rows)
        schedule.finish_frame()
    assert paths[0] == paths[1] == (paths[2] / 4 if seconds else paths[2])


def test_an_automatic_budget_takes_fewer_steps_where_training_is_dear():
    schedule = FrameSchedule(settings_of({**SMALL, "steps": 8, "budget": "auto", "mode": "frames"}))
    for _ in range(20):
        schedule.balance(0.9, 1.0)
    assert schedule.steps == 1
    for _ in range(20):
        schedule.balance(0.1, 1.0)
    assert schedule.steps == 8


def test_a_picture_by_time_takes_about_that_time():
    scene = room(32)
    make = lambda: NrcIntegrator(settings=settings_of({**SMALL, "mode": "still", "seconds": 1.0}))  # noqa: E731
    mi.render(scene, integrator=make(), spp=1)
    nrc = make()
    image = np.array(mi.render(scene, integrator=nrc, spp=1))
    dr.sync_thread()
    assert np.isfinite(image).all() and nrc.last.rendered.samples >= 1
    assert 0.2 < sum(nrc.last.seconds.values()) < 5  # the machine may be busy


def test_the_sensor_s_dictionary_needs_a_film():
    with pytest.raises(Exception, match=r"(?i)film|size|width|zero|> 0|pixel"):
        mi.load_dict({**sensor(8), "film": {"type": "hdrfilm", "width": 0, "height": 0}})
        raise ValueError("film of no size was taken")
