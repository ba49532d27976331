"""``lightwell_nrc``: rendering with the radiance cache as a Mitsuba integrator."""

from __future__ import annotations

import logging
import time
from typing import Any, NoReturn

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache import frames, restir, restir_gi, views
from lightwell.cache import guide_selector as pilot
from lightwell.cache.checks import check_hits, check_scene, check_sensor, check_variant
from lightwell.cache.denoising import check_film, denoised_image
from lightwell.cache.guide_table import CALM
from lightwell.cache.radiance_cache import RadianceCache, TrainingStats
from lightwell.cache.render_paths import PathState, render_path
from lightwell.cache.settings import CacheSettings, settings_of

# Samples per pixel from which 'auto' trains first and then renders with a frozen cache.
STILL_SPP = 8
# Training frames of a still: a first number, a further number per sample per pixel, and the largest sum.
WARMUP_FIRST, WARMUP_PER_SPP, WARMUP_MOST = 6, 0.1, 64
# A still with a time limit is path traced when gradient steps times relative variance of a path stay below this: so few
# steps would cost more time than they save (measured: the Cornell box, variance 0.8, gains from 90 steps on).
WORTH = 50.0
# Factor of WORTH where the image is denoised: the denoiser removes most of the noise, but not the cache's error
# (measured, times WORTH: staircase2 at 11 and living-room-2 at 4 gain, the Cornell box at 1.3 loses).
WORTH_DENOISED = 2.5
# Stills with estimator=guided train for this share of their time at most.
GUIDED_SHARE = 0.25
# Smallest number of samples per pixel used for the limit of caustics.
SPIKE_SAMPLES = 32
# The learning rate of a still falls to this share of the first.
FINAL_RATE = 0.1

# budget=auto: training takes this share of a frame's time at most.
TRAINING_SHARE = 0.25
LOG = logging.getLogger("lightwell.cache")

check_variant()


class NrcIntegrator(mi.ad.integrators.common.ADIntegrator):
    """Neural radiance cache: a path tracer that trains a small network while it renders.

    Every parameter of ``CacheSettings`` is a parameter of the plugin, in XML and in dictionaries, for example
    ``preset`` ('compact' or 'paper'), ``termination_c`` (0.01; infinity is plain path tracing), ``estimator``
    ('biased', or the unbiased 'guided', 'residual' and 'two-level'), ``first_hit`` ('nee', 'restir-di').

    Paths follow Mitsuba's ``path`` until their footprint is wide enough; there the network predicts the radiance that
    the surface scatters, and the path ends. The network is trained on a few paths per frame. The cache belongs to the
    integrator object and the scene: rendering the same scene again continues the training.

    Not supported: participating media, polarisation, spectral variants, derivatives of the image.

    Paper: Müller et al. 2021, *Real-time Neural Radiance Caching for Path Tracing*. This is an independent
    implementation.
    """

    def __init__(self, props: Any = None, settings: CacheSettings | None = None) -> None:
        """Read the parameters.

        Args:
            props: Mitsuba properties of the plugin; None: the defaults.
            settings: Settings; None: those of ``props``.
        """
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
        """Made when a scene is first rendered; assign a trained one to start from it."""
        self.stats: list[TrainingStats] = []
        """Training statistics of the last render, one entry per frame."""
        self.seconds: dict[str, float] = {}
        """Wall time of the last render by stage, seconds."""
        self._scene: Any = None
        self.reservoirs: Any = None
        """Reservoirs of the last pass, and the camera that they belong to."""
        self._pose = self._pose_mark = ""
        self._film: Any = None
        """Projection from world space to the film of the last pass with reservoirs."""
        self._began = 0.0
        self.caching = self.settings.caching
        """Whether the paths of this image may end in the cache; False in a still too short for training."""
        self.guiding = self.settings.guided
        """Whether the paths of this image are guided."""
        self.samples = 0
        """Samples per pixel of the last render."""

    def to_string(self) -> str:
        """Describe the integrator in one line.

        Returns:
            Text with preset, threshold and estimator.
        """
        s = self.settings
        return f"NrcIntegrator[preset = {s.preset}, c = {s.termination_c:g}, estimator = {s.estimator}]"

    # ------------------------------------------------------------------ the cache

    def cache_of(self, scene: Any) -> RadianceCache:
        """Return the cache of a scene; it is made on first use and prepared again for another scene.

        Args:
            scene: Mitsuba scene.

        Returns:
            The cache, ready for the scene.
        """
        if self.cache is None or (self._scene is not None and self._scene is not scene):
            self.cache = RadianceCache(self.settings)
        if self._scene is not scene or self.cache.materials is None:
            check_scene(scene)
            self.cache.prepare(scene)
            self._scene = scene
        return self.cache

    def scene_changed(self, kind: str = "light") -> None:
        """Announce a change of the scene.

        Args:
            kind: 'light', 'material', 'geometry' or 'camera'.
        """
        if self.cache is not None and self._scene is not None:
            self.cache.scene_changed(kind, self._scene)
            self.reservoirs = None

    def saw(self, sensor: Any) -> None:
        """Set the pose of the last pass, whose reservoirs were restored from a checkpoint.

        Args:
            sensor: Mitsuba sensor of that pass.
        """
        self._pose = self._pose_mark = str(sensor.world_transform())
        self._film = None if self.reservoirs is None else restir.world_to_film(sensor)

    # ------------------------------------------------------------------ rendering

    def render(
        self, scene: Any, sensor: Any = 0, seed: Any = 0, spp: int = 0, develop: bool = True, evaluate: bool = True
    ) -> Any:  # fmt: skip
        """Render an image and train the cache meanwhile.

        Args:
            scene: Mitsuba scene.
            sensor: Mitsuba sensor, or its index in the scene.
            seed: Seed; the same seed, settings and cache give the same image.
            spp: Samples per pixel; 0: those of the sensor's sampler.
            develop: Ignored; the image is always developed.
            evaluate: Ignored; the image is always evaluated.

        Returns:
            [H, W, C] tensor, linear RGB first.
        """
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
        self.stats, self.seconds = [], {"train": 0.0, "trace": 0.0}
        with dr.suspend_grad():
            film = sensor.film()
            film.prepare([])
            still = self._is_still(spp)
            if self.settings.caching and self.settings.guide == "auto":
                # Frames have no pilot; with a denoiser, the time is better spent on samples than on a guide.
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
        """Render a debug view, after the training of an image."""
        for _ in range(0 if still else spp):
            self._train(scene, sensor, cache, seed)
        if self.settings.view == "reservoir":
            return self._reservoir_view(scene, sensor, cache, seed)
        return mi.TensorXf(views.view(scene, sensor, cache, self.settings.view, spp, seed))

    def _reservoir_view(self, scene, sensor, cache, seed: int):
        """Red: logarithm of the weight W; green: candidates M over the largest number of one frame."""
        if self.settings.first_hit == "nee":
            raise ValueError("nrc: view 'reservoir' needs first_hit = 'restir-di'")
        self._direct(scene, self._rays(sensor, seed, 0, 1, 1), sensor, 1, 1)
        width, height = (int(x) for x in sensor.film().crop_size())
        weight, count = np.array(self.reservoir_W), np.array(self.reservoir_M)
        most = self.settings.restir_candidates * (1 + restir.HISTORY) * (1 + restir.NEIGHBOURS["biased"])
        picture = np.stack([np.log1p(weight), count / most, 0 * weight], -1).astype(np.float32)
        return mi.TensorXf(picture.reshape(height, width, 3))

    def render_forward(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Refuse: the integrator has no derivatives of the image.

        Args:
            *args: Ignored.
            **kwargs: Ignored.

        Raises:
            RuntimeError: Always.
        """
        raise RuntimeError("nrc: lightwell_nrc gives no derivatives of the picture; use 'prb' for them")

    render_backward = render_forward

    def _is_still(self, spp: int) -> bool:
        s = self.settings
        return s.learns and (s.mode == "still" or (s.mode == "auto" and (spp >= STILL_SPP or s.seconds > 0)))

    def warm_up(self, scene: Any, sensor: Any, seed: int, spp: int) -> None:
        """Train before a still; the learning rate falls to ``FINAL_RATE`` of the first, so that the average converges.

        Args:
            scene: Mitsuba scene.
            sensor: Mitsuba sensor.
            seed: Seed.
            spp: Samples per pixel of the still, which set the number of frames.
        """
        cache, s = self.cache_of(scene), self.settings
        most = s.warmup or int(min(WARMUP_FIRST + WARMUP_PER_SPP * spp, WARMUP_MOST))
        start = time.perf_counter()
        cache.still, cache.may_guide = True, self.guiding and (s.seconds > 0 or spp >= pilot.ENOUGH)
        share = s.train_share if s.caching else min(s.train_share, GUIDED_SHARE)
        done = 0.0
        while done < 1 and not cache.frozen:
            cache.rate_factor = FINAL_RATE**done
            self._train(scene, sensor, cache, seed)
            if not s.caching and cache.frame == 1 and self.stats[-1].noise < CALM:
                self.guiding = False
                break
            if s.seconds > 0:
                done = (time.perf_counter() - start) / (share * s.seconds)
                if s.caching and len(self.stats) == 2 and cache.frame == 2 and not self._pays(self.stats[1]):
                    self.caching = False
                    break
            else:
                done += 1 / most
        cache.rate_factor, cache.still = 1.0, False
        if s.seconds > 0 and cache.frame == 1:
            self.caching = False  # A single training frame: too little to train, or to estimate whether it pays.
        self.guiding &= self.caching or not s.caching
        if self.caching:
            cache.settle()
        dr.sync_thread()
        self.seconds["train"] += time.perf_counter() - start

    def _pays(self, stats: TrainingStats) -> bool:
        """Whether a still with a time limit has time for enough steps; less noisy images need a more accurate cache."""
        steps = stats.steps * self.settings.train_share * self.settings.seconds / sum(stats.seconds.values())
        return not steps * stats.noise < WORTH * (WORTH_DENOISED if self.settings.denoise else 1)

    def _train(self, scene, sensor, cache: RadianceCache, seed: int) -> None:
        stats = cache.train_frame(scene, sensor, seed)
        if stats.changed:
            self.reservoirs = None
        self.stats.append(stats)
        if cache.frame == 1 and stats.steps == 0 and stats.hits >= 0:
            check_hits(stats.hits, sensor)

    def _passes(self, scene, sensor, cache, seed: int, spp: int, still: bool):
        """Render all samples, in passes of one sample (frames) or of as many as fit (stills)."""
        film = sensor.film()
        width, height = (int(x) for x in film.crop_size())
        timed = self.settings.seconds > 0
        launch = frames.SMALL_LAUNCH if timed else frames.LAUNCH
        # A frozen cache needs no separate frames, except for the temporal reuse of reservoirs.
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
        """Test whether the guide, if there is one, pays; returns the number of samples used, all in the image."""
        trial, done = pilot.GuideSelector(), 0
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
        """Set the largest luminance of a caustic in one sample, for the given number of samples per pixel."""
        cap = self.settings.spike_cap
        most = cap * cache.scale.mean * max(samples, SPIKE_SAMPLES) if still and cap > 0 else 3e38
        cache.around.spike = dr.opaque(mi.Float, most)

    def _balance(self, cache: RadianceCache, training: float, frame: float) -> None:
        """budget=auto: limit training to a quarter of the frame time, by the number of gradient steps and paths."""
        dr.sync_thread()
        now = cache.most_steps or self.settings.steps
        share = training / max(frame, 1e-9)
        wanted = now - 1 if share > TRAINING_SHARE else now + 1 if share < 0.7 * TRAINING_SHARE else now
        wanted = min(max(wanted, 1), self.settings.steps)
        if wanted != now:
            LOG.info("nrc: training takes %.0f %% of a frame; %d steps from now on", 100 * share, wanted)
        cache.most_steps = wanted

    def _second_level(self, scene, sensor, cache, seed: int, spp: int):
        """Estimate the error of the cache with full paths, one for every ``level_samples`` cheap ones."""
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
        """Direct light at the first hits from reservoirs, with temporal reuse that follows the surfaces."""
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
        """Radiance along the camera rays, with indirect light at the first hit from reservoirs, and mask of the hits.

        Rays that hit a mirror first follow plain paths.
        """
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
        walk = PathState(ray)
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
    """Derive a seed for random numbers that must be independent of those of ``seed``.

    Args:
        seed: 32-bit seed.

    Returns:
        32-bit seed.
    """
    return (seed * 0x9E3779B1 + 0x7F4A7C15) & 0xFFFFFFFF


def register() -> None:
    """Register ``lightwell_nrc`` with the active Mitsuba variant."""
    mi.register_integrator("lightwell_nrc", lambda props: NrcIntegrator(props))
