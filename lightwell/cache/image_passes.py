"""The passes over the film that add up to an image, and the training between them."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache import frames
from lightwell.cache.guide_selector import ENOUGH, PARTS, PASSES, GuideSelector
from lightwell.cache.guide_trial import GuideTrial, has_trial
from lightwell.cache.image_state import ImageState, keeps_half, train_frame
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.sobol_sampler import GOLDEN

# Smallest number of samples per pixel used for the limit of caustics.
SPIKE_SAMPLES = 32
# Passes of an image with a time limit take at most this share of the time left, and have so many lanes: samples of
# launches of 2^22 lanes cost 5 to 10 % less than those of 2^18 (zdm2, kenney-fps-level, hello-webxr-hall).
LARGE_SHARE, LARGE_LAUNCH = 0.75, 1 << 22


def limit_caustics(cache: RadianceCache, samples: int) -> None:
    """Set the largest luminance of a caustic in one sample.

    Args:
        cache: Cache of the scene.
        samples: Samples per pixel of a still so far; 0: no limit.
    """
    cap = cache.settings.image.spike_cap
    limited = samples > 0 and cap > 0
    most = cap * cache.predictor.scale.mean * max(samples, SPIKE_SAMPLES) if limited else 3e38
    cache.region.context.spike = dr.opaque(mi.Float, most)


class TimeLimit:
    """Sizes of the passes of an image with a time limit, and when there is no time for another."""

    def __init__(self, per_pass: int, most: int, end: float, recorded: bool = False, pairs: bool = False) -> None:
        """Know no pass yet.

        Args:
            per_pass: Samples per pixel of a small pass.
            most: Samples per pixel of the largest one.
            end: Time at which the image should be finished, of ``time.perf_counter``.
            recorded: Whether the kernels of the passes are compiled already.
            pairs: Whether every second pass is as large as the one before it, so that both halves of an image are.
        """
        self.per_pass, self.most, self.end = per_pass, most, end
        self.samples, self.seconds = 0, 0.0
        """Samples per pixel of the passes that were timed, and their time."""
        self.recorded = recorded
        """Whether the time of the next pass is that of its samples alone."""
        self.pairs, self.first = pairs, 0
        """Samples per pixel of the first pass of a pair whose second comes next; 0: none."""

    def block(self, now: float, small: bool) -> int:
        """Choose the size of the next pass.

        Args:
            now: Current time.
            small: Whether it must be a small one.

        Returns:
            Samples per pixel.
        """
        block = self.first or self.per_pass
        if small or self.first or not self.samples:
            return block
        share = LARGE_SHARE / 2 if self.pairs else LARGE_SHARE
        # Powers of two times the small one: sequences are even over whole blocks.
        while 2 * block <= self.most and 2 * block * self.each < share * (self.end - now):
            block *= 2
        return block

    def ends(self, block: int, start: float, now: float) -> bool:
        """Take note of a pass.

        Args:
            block: Its samples per pixel.
            start: Time at which it began.
            now: Current time.

        Returns:
            Whether there is no time for another small pass.
        """
        if self.recorded:
            self.samples, self.seconds = self.samples + block, self.seconds + now - start
        self.recorded = True
        self.first = block if self.pairs and not self.first else 0
        return now + self.each * self.per_pass > self.end

    @property
    def each(self) -> float:
        """Return the mean time of a sample per pixel.

        Returns:
            Seconds; 0 while no pass has been timed.
        """
        return self.seconds / max(self.samples, 1)


class ImagePasses:
    """Renders the samples of one image, in passes of one sample (frames) or of as many as fit (stills)."""

    def __init__(self, image: ImageState) -> None:
        """Prepare the passes.

        Args:
            image: The image, after the training of a still.
        """
        self.image, self.settings = image, image.settings
        self.film = image.sensor.film()
        width, height = (int(x) for x in self.film.crop_size())
        self.pixels = width * height
        self.timed = self.settings.image.seconds > 0
        self.learns = image.caching or image.guiding
        self.half = self.film.create_block() if keeps_half(image) else None
        """Sums of every second pass, where half of the samples is kept."""
        self.turns = 0

    def render(self) -> mi.TensorXf:
        """Render all samples; with a time limit, as many as there is time for.

        Returns:
            [H, W, C] image.
        """
        image, estimator = self.image, self.settings.estimation.estimator
        two_level = estimator == "two-level" and image.caching
        per_pass, trains = self._per_pass(), not image.still and self.learns and not image.cache.frozen
        began, first = time.perf_counter(), 0.0
        if two_level and trains:
            # All passes and the second level must read the same predictions: train first, a frame for every sample.
            trains, first = False, sum(self._train() for _ in range(image.spp))
        done, aside = self._trial() if has_trial(image) else (self._pilot(per_pass), 0)
        most, end = max(per_pass, LARGE_LAUNCH // self.pixels), image.began + self.settings.image.seconds
        limit = TimeLimit(per_pass, most, end, recorded=done > 0, pairs=self.half is not None)
        while done < image.spp or self.timed:
            start = time.perf_counter()
            block = limit.block(start, trains) if self.timed else min(per_pass, image.spp - done)
            trained = self._train() if trains else None
            self._add(done, block, "biased" if two_level else estimator)
            done += block
            if trained is not None and self.settings.training.budget == "auto":
                dr.sync_thread()
                image.cache.schedule.balance(trained, time.perf_counter() - start)
            if self.timed:
                dr.eval()
                dr.sync_thread()
                if limit.ends(block, start, time.perf_counter()):
                    break
        image.rendered.samples = done + aside
        image.rendered.half = self._kept_half(done)
        developed = self.film.develop()
        if two_level:
            developed = developed + self._second_level(done)
        if first > 0 and self.settings.training.budget == "auto":
            dr.eval(developed)
            dr.sync_thread()
            image.cache.schedule.balance(first, time.perf_counter() - began)
        return developed

    def _per_pass(self) -> int:
        """Samples per pixel of a pass."""
        image, s = self.image, self.settings
        if s.image.sampling == "sensor":
            return image.spp if image.still or not self.learns else 1
        # A frozen cache needs no separate frames, except for the temporal reuse of reservoirs.
        whole = image.still or not self.learns or (image.cache.frozen and s.estimation.first_hit == "nee")
        most = max(1, (frames.SMALL_LAUNCH if self.timed else frames.LAUNCH) // self.pixels) if whole else 1
        # Halves are two passes at least.
        return most if self.half is None or self.timed else min(most, -(-image.spp // 2))

    def _train(self) -> float:
        """Train between passes; returns the seconds."""
        start = time.perf_counter()
        train_frame(self.image)
        seconds = time.perf_counter() - start
        self.image.seconds["train"] += seconds
        return seconds

    def _add(self, done: int, block: int, estimator: str) -> Any:
        """Add a pass to the film; returns its image block."""
        image = self.image
        # 'two-level' reads biased passes, too, but adds their error: both must be without a limit.
        limited = image.still and self.settings.estimation.estimator == "biased"
        limit_caustics(image.cache, done + block if limited else 0)
        second = self.half is not None and self.turns % 2 == 1
        self.turns += 1
        # Parts of one sequence are not independent: the second half has another.
        seed = mixed_seed(image.seed) if second else image.seed
        put = self._pass(seed, done, block, image.spp, estimator)
        self.film.put_block(put)
        if self.half is not None and not second:
            self.half.put_block(put)
        return put

    def _kept_half(self, samples: int) -> tuple[np.ndarray, float] | None:
        """Mean of the samples of every second pass, and their share; None where there was one pass alone."""
        if self.half is None or self.turns < 2:
            return None
        sums = np.array(self.half.tensor())
        weight = sums[..., -1:]
        return sums[..., :3] / np.maximum(weight, 1), float(weight.mean()) / samples

    def _pilot(self, per_pass: int) -> int:
        """Test whether the guide, if there is one, pays; returns the number of samples used, all in the image."""
        image, s = self.image, self.settings
        if not (image.still and image.caching and image.guiding and s.guiding.guide == "auto"):
            return 0
        if image.cache.guiding.guide is None or (not self.timed and image.spp < ENOUGH):
            image.guiding = False
            return 0
        trial, done = GuideSelector(), 0
        image.pilot = trial
        block = per_pass if self.timed else max(1, image.spp // PARTS)
        for guided in (False, True) * PASSES:
            start = time.perf_counter()
            image.guiding = guided
            sums: Any = 0
            # No launch is larger than those of the other passes: memory grows with it.
            for part in range(0, block, per_pass):
                tensor = self._add(done + part, min(per_pass, block - part), "biased").tensor()
                dr.eval(tensor)
                sums = sums + np.array(tensor)
            dr.sync_thread()
            trial.add(guided, sums, time.perf_counter() - start)
            done += block
            if 0 < s.image.seconds < time.perf_counter() - image.began:
                break
        image.guiding = trial.guide_pays(self.timed)
        return done

    def _trial(self) -> tuple[int, int]:
        """Decide whether an unbiased still is guided; returns the samples of its sequence that are used, and others."""
        image = self.image

        def trace(guided: bool, number: int) -> Any:
            image.guiding = guided
            # Guided passes have a sequence of their own, so that the samples of plain ones stay contiguous.
            seed = mixed_seed(image.seed) if guided else image.seed
            return self._pass(seed, number, 1, image.spp, image.settings.estimation.estimator)

        trial = GuideTrial(image, trace)
        image.pilot = trial.selector
        trial.run()
        for block in trial.blocks():
            self.film.put_block(block)
        return len(trial.held[False]), len(trial.held[True])

    def _second_level(self, spp: int) -> mi.TensorXf:
        """Estimate the error of the cache with full paths, one for every ``level_samples`` cheap ones; 0 in alpha."""
        count = max(1, spp // self.settings.estimation.level_samples)
        self.film.clear()
        per_pass = max(1, frames.LAUNCH // self.pixels)
        for done in range(0, count, per_pass):
            block = min(per_pass, count - done)
            put = self._pass(mixed_seed(self.image.seed), done, block, count, "difference")
            self.film.put_block(put)
        developed = self.film.develop()
        factors = np.ones((1, 1, developed.shape[-1]), np.float32)
        if put.channel_count() == 5:
            factors[..., -1] = 0
        return developed * mi.TensorXf(factors)

    def _pass(self, seed: int, done: int, block: int, spp: int, estimator: str) -> Any:
        """Render one pass as an image block."""
        image, s = self.image, self.settings.estimation
        scene, cache, sensor = image.scene, image.cache, image.sensor
        q, guide = s.residual_probability, cache.guiding.guide if image.guiding else None
        reservoirs = s.first_hit != "nee" and estimator != "difference"
        if not reservoirs and self.settings.image.sampling == "sobol":
            numbers = [dr.opaque(mi.UInt32, x & 0xFFFFFFFF) for x in (done, block, seed)]
            L, valid, place = frames.sobol_pass(
                scene, sensor, cache, numbers, self.pixels * block, estimator, q, image.caching, guide
            )  # fmt: skip
            return frames.splat(self.film, L, valid, place, block >= 4)
        rays = self.rays(seed, done, block, spp)
        if s.first_hit == "restir-gi" and reservoirs:
            L, valid = image.reservoirs.bounced(scene, cache, rays, sensor, block, image.caching)
            return frames.splat(self.film, L * rays[1], valid, rays[2], block >= 4)
        direct = image.reservoirs.direct(scene, rays, sensor, block) if reservoirs else mi.Spectrum(0)
        L, valid, place = frames.trace_pass(scene, cache, rays, estimator, q, not reservoirs, image.caching, guide)
        return frames.splat(self.film, L + direct * rays[1], valid, place, block >= 4)

    def rays(self, seed: int, done: int, block: int, spp: int) -> frames.Rays:
        """Sample the camera rays of a pass.

        Args:
            seed: Seed.
            done: Samples per pixel of the passes before it.
            block: Samples per pixel of the pass.
            spp: Samples per pixel of all passes.

        Returns:
            Camera rays.
        """
        sensor = self.image.sensor
        if self.settings.image.sampling == "sensor":
            sampler = sensor.sampler().clone()
            sampler.set_sample_count(spp)
            sampler.set_samples_per_wavefront(block)
            # Images of successive seeds must not share passes.
            sampler.seed((seed + done * GOLDEN) & 0xFFFFFFFF, self.pixels * block)
            return frames.sampled_rays(sensor, sampler, block)
        numbers = [dr.opaque(mi.UInt32, x & 0xFFFFFFFF) for x in (done, block, seed)]
        return frames.sobol_rays(sensor, numbers, dr.arange(mi.UInt32, self.pixels * block))


def mixed_seed(seed: int) -> int:
    """Derive a seed for random numbers that must be independent of those of ``seed``.

    Args:
        seed: 32-bit seed.

    Returns:
        32-bit seed.
    """
    return (seed * GOLDEN + 0x7F4A7C15) & 0xFFFFFFFF
