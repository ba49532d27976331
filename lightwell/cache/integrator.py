"""``lightwell_nrc``: the radiance cache as a Mitsuba integrator."""

from __future__ import annotations

import logging
import time
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache import frames, pilot, restir, restir_gi, views
from lightwell.cache.checks import check_hits, check_scene, check_sensor, check_variant
from lightwell.cache.denoising import check_film, denoised_image
from lightwell.cache.guide_table import CALM
from lightwell.cache.paths import Walk, render_path
from lightwell.cache.radiance_cache import RadianceCache, Told
from lightwell.cache.settings import CacheSettings, settings_of

# Samples per pixel from which 'auto' trains first and then renders with a frozen cache.
STILL_SPP = 8
# Frames of training of a still: this many, and so many more per sample per pixel, at most.
WARMUP_FIRST, WARMUP_PER_SPP, WARMUP_MOST = 6, 0.1, 64
# A still by time is path traced when gradient steps times relative variance of a path stay below this: what so few
# steps can teach would cost more than it brings (measured: the Cornell box, variance 0.8, gains from 90 steps on).
WORTH = 50.0
# Times as much where the picture is denoised: the denoiser takes most of the noise, and leaves the cache's error
# (measured, times WORTH: staircase2 at 11 and living-room-2 at 4 gain, the Cornell box at 1.3 loses).
WORTH_DENOISED = 2.5
# Stills with estimator=guided train for this share of their time at most.
GUIDED_SHARE = 0.25
# Samples per pixel at least that the cap of caustics counts with.
SPIKE_SAMPLES = 32
# The learning rate of a still falls to this share of the first.
FINAL_RATE = 0.1

# budget=auto: training takes this share of a frame's time at most.
TRAINING_SHARE = 0.25
LOG = logging.getLogger("lightwell.cache")

check_variant()


class NrcIntegrator(mi.ad.integrators.common.ADIntegrator):
    """Neural radiance cache: a path tracer that learns while it renders.

    Every parameter of ``CacheSettings`` is a parameter of the plugin, in XML and in dictionaries, for example
    ``preset`` ('compact' or 'paper'), ``termination_c`` (0.01; infinity is plain path tracing), ``estimator``
    ('biased', or the unbiased 'guided', 'residual' and 'two-level'), ``first_hit`` ('nee', 'restir-di').

    Paths follow Mitsuba's ``path`` until their footprint has spread; there a small network answers with the light that
    the surface scatters. The network learns from a few training paths per frame. The cache belongs to the integrator
    object and the scene: rendering the same scene again goes on learning.

    Cannot: participating media, polarisation, spectral variants, derivatives of the picture.

    Papers: Müller et al. 2021, *Real-time Neural Radiance Caching for Path Tracing*. An independent implementation.
    """

    def __init__(self, props: Any = None, settings: CacheSettings | None = None) -> None:
        if props is None:
            props = mi.Properties("lightwell_nrc")
        if settings is None:
            settings = settings_of({name: props[name] for name in props.keys()})
        base = mi.Properties("lightwell_nrc")
        super().__init__(base)
        self.settings = settings
        self.max_depth = settings.max_depth if settings.max_depth >= 0 else 0xFFFFFFFF
        self.rr_depth = settings.rr_depth
        self.cache: RadianceCache | None = None
        """Made when a scene is first rendered; assign one to start warm."""
        self.told: list[Told] = []
        """What the last render said about its training."""
        self.seconds: dict[str, float] = {}
        """Wall time of the last render by stage."""
        self._scene: Any = None
        self.reservoirs: Any = None
        """Reservoirs of the last pass, and the camera that they belong to."""
        self._pose = self._pose_mark = ""
        self._film: Any = None
        """Takes the world to the film of the last pass with reservoirs."""
        self._began = 0.0
        self.caching = self.settings.caching
        """Whether the paths of this picture may end in the cache; not in a still too short to learn anything."""
        self.guiding = self.settings.guided
        """Likewise, whether they are guided."""
        self.samples = 0
        """Samples per pixel of the last render."""

    def to_string(self) -> str:
        s = self.settings
        return f"NrcIntegrator[preset = {s.preset}, c = {s.termination_c:g}, estimator = {s.estimator}]"

    # ------------------------------------------------------------------ the cache

    def cache_of(self, scene: Any) -> RadianceCache:
        """The cache that belongs to a scene, made on first use."""
        if self.cache is None or (self._scene is not None and self._scene is not scene):
            self.cache = RadianceCache(self.settings)
        if self._scene is not scene or self.cache.materials is None:
            check_scene(scene)
            self.cache.prepare(scene)
            self._scene = scene
        return self.cache

    def scene_changed(self, kind: str = "light") -> None:
        """Hint that 'light', 'material', 'geometry' or 'camera' changed."""
        if self.cache is not None and self._scene is not None:
            self.cache.scene_changed(kind, self._scene)
            self.reservoirs = None

    def saw(self, sensor: Any) -> None:
        """Take the pose of ``sensor`` for that of the last pass, whose reservoirs are restored from a checkpoint."""
        self._pose = self._pose_mark = str(sensor.world_transform())
        self._film = None if self.reservoirs is None else restir.world_to_film(sensor)

    # ------------------------------------------------------------------ rendering

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        """The picture [H, W, C]; trains on the way."""
        if isinstance(sensor, int):
            sensor = scene.sensors()[sensor]
        check_sensor(sensor)
        if self.settings.denoise:
            check_film(sensor)
        seed = int(mi.UInt32(seed)[0]) if not isinstance(seed, int) else seed
        spp = spp or int(sensor.sampler().sample_count())
        self._began, self.caching = time.perf_counter(), self.settings.caching
        self.guiding = self.settings.guided
        cache = self.cache_of(scene)
        self._pose = str(sensor.world_transform())
        self.told, self.seconds = [], {"train": 0.0, "trace": 0.0}
        with dr.suspend_grad():
            film = sensor.film()
            film.prepare([])
            still = self._is_still(spp)
            if self.settings.caching and self.settings.guide == "auto":
                # Frames have no pilot; a denoiser takes what a guide would take, and would rather have the samples.
                self.guiding &= still and not self.settings.denoise
            if still:
                self.warm_up(scene, sensor, seed, spp)
            if self.settings.view != "image":
                return self._view(scene, sensor, cache, seed, spp, still)
            start = time.perf_counter()
            image = self._passes(scene, sensor, cache, seed, spp, still)
            dr.eval(image)
            self.seconds["trace"] += time.perf_counter() - start - (0 if still else self.seconds["train"])
            if self.settings.denoise:
                image = denoised_image(scene, sensor, cache, image, seed)
        return image

    def _view(self, scene, sensor, cache, seed: int, spp: int, still: bool):
        """A debug view, after the training that a picture would have had."""
        for _ in range(0 if still else spp):
            self._train(scene, sensor, cache, seed)
        if self.settings.view == "reservoir":
            return self._reservoir_view(scene, sensor, cache, seed)
        return mi.TensorXf(views.view(scene, sensor, cache, self.settings.view, spp, seed))

    def _reservoir_view(self, scene, sensor, cache, seed: int):
        """Red: logarithm of the weight W; green: candidates M over what one frame can bring."""
        if self.settings.first_hit == "nee":
            raise ValueError("nrc: view 'reservoir' needs first_hit = 'restir-di'")
        self._direct(scene, self._rays(sensor, seed, 0, 1, 1), sensor, 1, 1)
        width, height = (int(x) for x in sensor.film().crop_size())
        weight, count = np.array(self.reservoir_W), np.array(self.reservoir_M)
        most = self.settings.restir_candidates * (1 + restir.HISTORY) * (1 + restir.NEIGHBOURS["biased"])
        picture = np.stack([np.log1p(weight), count / most, 0 * weight], -1).astype(np.float32)
        return mi.TensorXf(picture.reshape(height, width, 3))

    def render_forward(self, *args, **kwargs):
        raise RuntimeError("nrc: lightwell_nrc gives no derivatives of the picture; use 'prb' for them")

    render_backward = render_forward

    def _is_still(self, spp: int) -> bool:
        s = self.settings
        return s.learns and (s.mode == "still" or (s.mode == "auto" and (spp >= STILL_SPP or s.seconds > 0)))

    def warm_up(self, scene, sensor, seed: int, spp: int) -> None:
        """Train before a still: the rate falls to a tenth, so that the average settles."""
        cache, s = self.cache_of(scene), self.settings
        most = s.warmup or int(min(WARMUP_FIRST + WARMUP_PER_SPP * spp, WARMUP_MOST))
        start = time.perf_counter()
        cache.still, cache.may_guide = True, self.guiding and (s.seconds > 0 or spp >= pilot.ENOUGH)
        share = s.train_share if s.caching else min(s.train_share, GUIDED_SHARE)
        done = 0.0
        while done < 1 and not cache.frozen:
            cache.rate_factor = FINAL_RATE**done
            self._train(scene, sensor, cache, seed)
            if not s.caching and cache.frame == 1 and self.told[-1].noise < CALM:
                self.guiding = False
                break
            if s.seconds > 0:
                done = (time.perf_counter() - start) / (share * s.seconds)
                if s.caching and len(self.told) == 2 and cache.frame == 2 and not self._pays(self.told[1]):
                    self.caching = False
                    break
            else:
                done += 1 / most
        cache.rate_factor, cache.still = 1.0, False
        if s.seconds > 0 and cache.frame == 1:
            self.caching = False  # One frame of a cold cache: no time to learn, nor to find out whether that pays.
        self.guiding &= self.caching or not s.caching
        if self.caching:
            cache.settle()
        dr.sync_thread()
        self.seconds["train"] += time.perf_counter() - start

    def _pays(self, told: Told) -> bool:
        """Whether a still by time has time for steps enough; calmer pictures need a better cache to gain from it."""
        steps = told.steps * self.settings.train_share * self.settings.seconds / sum(told.seconds.values())
        return not steps * told.noise < WORTH * (WORTH_DENOISED if self.settings.denoise else 1)

    def _train(self, scene, sensor, cache: RadianceCache, seed: int) -> None:
        told = cache.train_frame(scene, sensor, seed)
        if told.changed:
            self.reservoirs = None
        self.told.append(told)
        if cache.frame == 1 and told.steps == 0 and told.hits >= 0:
            check_hits(told.hits, sensor)

    def _passes(self, scene, sensor, cache, seed: int, spp: int, still: bool):
        """All samples, in passes of one sample (frames) or of as many as fit (stills)."""
        film = sensor.film()
        width, height = (int(x) for x in film.crop_size())
        timed = self.settings.seconds > 0
        launch = frames.SMALL_LAUNCH if timed else frames.LAUNCH
        # A cache that learns no more needs no frames, unless reservoirs hand on their past from one to the next.
        learns = self.caching or self.guiding
        whole = still or not learns or (cache.frozen and self.settings.first_hit == "nee")
        per_pass = max(1, launch // (width * height)) if whole else 1
        if self.settings.sampling == "sensor":
            per_pass = spp if still or not learns else 1
        two_level = self.settings.estimator == "two-level" and self.caching
        kind = "biased" if two_level else self.settings.estimator
        done, longest = 0, 0.0
        if still and self.caching and self.guiding and self.settings.guide == "auto":
            small = per_pass if timed else max(1, spp // pilot.PARTS)
            done = self._pilot(scene, sensor, cache, seed, small, spp)
        while done < spp or timed:
            start = time.perf_counter()
            block = per_pass if timed else min(per_pass, spp - done)
            trains = not still and learns and not cache.frozen
            if trains:
                self._train(scene, sensor, cache, seed)
                self.seconds["train"] += time.perf_counter() - start
            trained = time.perf_counter() - start
            self._cap_spikes(cache, still, done + block)
            film.put_block(self._pass(scene, sensor, cache, seed, done, block, spp, kind))
            done += block
            if trains and self.settings.budget == "auto":
                self._balance(cache, trained, time.perf_counter() - start)
            if timed:
                dr.eval()
                dr.sync_thread()
                longest = max(longest, time.perf_counter() - start) if done > block else 0.0
                if time.perf_counter() - self._began + longest > self.settings.seconds:
                    break
        self.samples = done
        image = film.develop()
        if two_level:
            image = image + self._second_level(scene, sensor, cache, seed, done)
        return image

    def _pilot(self, scene, sensor, cache, seed: int, block: int, spp: int) -> int:
        """Find out whether the guide pays, where there is one; how many samples that took, all in the picture."""
        trial, done = pilot.Pilot(), 0
        if cache.guide is None or (self.settings.seconds <= 0 and spp < pilot.ENOUGH):
            self.guiding = False
            return 0
        for guided in (False, True) * pilot.PASSES:
            start = time.perf_counter()
            self.guiding = guided
            self._cap_spikes(cache, True, done + block)
            put = self._pass(scene, sensor, cache, seed, done, block, spp, "biased")
            sensor.film().put_block(put)
            dr.eval(put.tensor())
            dr.sync_thread()
            trial.add(guided, put, time.perf_counter() - start)
            done += block
            if 0 < self.settings.seconds < time.perf_counter() - self._began:
                break
        self.guiding = trial.guide_pays(self.settings.seconds > 0)
        return done

    def _cap_spikes(self, cache: RadianceCache, still: bool, samples: int) -> None:
        """Say how bright a caustic may be in one of so many samples per pixel."""
        cap = self.settings.spike_cap
        most = cap * cache.scale.mean * max(samples, SPIKE_SAMPLES) if still and cap > 0 else 3e38
        cache.around.spike = dr.opaque(mi.Float, most)

    def _balance(self, cache: RadianceCache, training: float, frame: float) -> None:
        """budget=auto: hold training to a quarter of the frame's time, by its steps and with them its paths."""
        dr.sync_thread()
        now = cache.most_steps or self.settings.steps
        share = training / max(frame, 1e-9)
        wanted = now - 1 if share > TRAINING_SHARE else now + 1 if share < 0.7 * TRAINING_SHARE else now
        wanted = min(max(wanted, 1), self.settings.steps)
        if wanted != now:
            LOG.info("nrc: training takes %.0f %% of a frame; %d steps from now on", 100 * share, wanted)
        cache.most_steps = wanted

    def _second_level(self, scene, sensor, cache, seed: int, spp: int):
        """What full paths say beyond the cache, from one path for every ``level_samples`` cheap ones."""
        film = sensor.film()
        count = max(1, spp // self.settings.level_samples)
        film.clear()
        width, height = (int(x) for x in film.crop_size())
        per_pass = max(1, frames.LAUNCH // (width * height))
        done = 0
        while done < count:
            block = min(per_pass, count - done)
            other = mixed_seed(seed)
            film.put_block(self._pass(scene, sensor, cache, other, done, block, count, "difference"))
            done += block
        return film.develop()

    def _pass(self, scene, sensor, cache, seed: int, done: int, block: int, spp: int, estimator: str):
        """One pass as an image block."""
        film = sensor.film()
        q, guide = self.settings.residual_probability, cache.guide if self.guiding else None
        reservoirs = self.settings.first_hit != "nee" and estimator != "difference"
        width, height = (int(x) for x in film.crop_size())
        if not reservoirs and self.settings.sampling == "sobol":
            numbers = [dr.opaque(mi.UInt32, x & 0xFFFFFFFF) for x in (done, block, seed)]
            L, valid, _, _, place = frames.sobol_pass(
                scene, sensor, cache, numbers, width * height * block, estimator, q, self.caching, guide
            )  # fmt: skip
            return frames.splat(film, L, valid, place, [], block >= 4)
        rays = self._rays(sensor, seed, done, block, spp)
        if self.settings.first_hit == "restir-gi" and reservoirs:
            L, valid = self._bounced(scene, cache, rays, sensor, block)
            return frames.splat(film, L * rays[1], valid, rays[2], rays[0].wavelengths, block >= 4)
        direct = self._direct(scene, rays, sensor, block, spp) if reservoirs else mi.Spectrum(0)
        L, valid, _, _, place = frames.trace_pass(scene, cache, rays, estimator, q, not reservoirs, self.caching, guide)
        L += direct * rays[1]
        return frames.splat(film, L, valid, place, rays[0].wavelengths, block >= 4)

    def _direct(self, scene, rays, sensor, block: int, spp: int):
        """Direct light at the first hits from reservoirs; they remember the last pass, and follow the surfaces."""
        s = self.settings
        unbiased = s.restir_reuse == "unbiased"
        ray, sampler = mi.Ray3f(rays[0]), rays[3]
        width, height = (int(x) for x in sensor.film().crop_size())
        before = self.reservoirs
        temporal = (
            not unbiased and block == 1 and before is not None and dr.width(before.W) == width * height
            and (self._film is not None or self._pose_mark == self._pose)
        )  # fmt: skip
        numbers = [dr.opaque(mi.UInt32, x) for x in (s.restir_candidates, width, height, block)]
        candidates, *size = numbers
        past = before if temporal else restir.Reservoirs()
        held = restir.choose(scene, ray, sampler, candidates, past, temporal, self._film, *size[:2])
        dr.eval(held)
        self.reservoirs, self._pose_mark = (held if block == 1 else None), self._pose
        self._film = restir.world_to_film(sensor)
        L, self.reservoir_W, self.reservoir_M = restir.shade(
            scene, ray, sampler, held, *size, restir.NEIGHBOURS[s.restir_reuse], unbiased
        )
        dr.eval(L)
        return L

    def _bounced(self, scene, cache, rays, sensor, block: int):
        """All light along the camera rays, that of one bounce and more at the first hit from reservoirs, and whether
        anything was met. Rays that meet a mirror first follow plain paths."""
        s = self.settings
        ray, sampler = mi.Ray3f(rays[0]), rays[3]
        sizes = [dr.opaque(mi.UInt32, int(x)) for x in (*sensor.film().crop_size(), block)]
        evaluate = frames.evaluator(cache)
        held, rest, usable = restir_gi.choose(scene, ray, sampler, cache.around, evaluate, self.caching)
        dr.eval(held, rest, usable, sampler)
        unbiased, count = s.restir_reuse == "unbiased", restir.NEIGHBOURS[s.restir_reuse]
        shared, self.reservoir_W, self.reservoir_M = restir_gi.shade(
            scene, ray, sampler, held, *sizes, count, unbiased
        )  # fmt: skip
        walk = Walk(ray)
        walk.active = ~usable
        plain, valid, *_ = render_path(
            scene, sampler, walk, cache.around, evaluate, mi.Float(1), self.caching, "biased", True
        )  # fmt: skip
        L = dr.select(usable, rest + shared, dr.select(dr.all(dr.isfinite(plain)), plain, 0))
        dr.eval(L)
        return L, valid | usable

    def _rays(self, sensor, seed: int, done: int, block: int, spp: int):
        if self.settings.sampling == "sensor":
            sampler = sensor.sampler().clone()
            sampler.set_sample_count(spp)
            sampler.set_samples_per_wavefront(block)
            width, height = (int(x) for x in sensor.film().crop_size())
            sampler.seed(seed + done, width * height * block)
            return frames.sampled_rays(sensor, sampler, block)
        width, height = (int(x) for x in sensor.film().crop_size())
        numbers = [dr.opaque(mi.UInt32, x & 0xFFFFFFFF) for x in (done, block, seed)]
        return frames.sobol_rays(sensor, *numbers, width * height * block)


def mixed_seed(seed: int) -> int:
    """A seed for numbers that must not be those of ``seed``."""
    return (seed * 0x9E3779B1 + 0x7F4A7C15) & 0xFFFFFFFF


def register() -> None:
    """Make ``lightwell_nrc`` known to the active Mitsuba variant."""
    mi.register_integrator("lightwell_nrc", lambda props: NrcIntegrator(props))
