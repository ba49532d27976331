"""Training before a still.

A still that is denoised has none, and its paths do not end in the cache: the denoiser removes noise, not the blur of
the network. Equal time, 16 scenes, blended with the cache's view where that was nearer to the truth: denoised ``path``
over ours, relMSE 0.98 (geometric mean), FLIP 0.53 to 1.02 (one scene 1.24). Path traced with our sampling: relMSE 1.00
to 2.1, FLIP 0.95 to 1.24.
"""

from __future__ import annotations

import time

from lightwell.backend import dr
from lightwell.cache.guide_selector import ENOUGH
from lightwell.cache.guide_trial import FIRST_SHARE, has_trial, train_guide
from lightwell.cache.image_state import ImageState, train_frame
from lightwell.cache.settings import CacheSettings
from lightwell.cache.training_stats import TrainingStats

# Training frames of a still: a first number, a further number per sample per pixel, and the largest sum.
WARMUP_FIRST, WARMUP_PER_SPP, WARMUP_MOST = 6, 0.1, 64
# A still with a time limit is path traced when gradient steps times relative variance of a path stay below this: so few
# steps would cost more time than they save (measured: the Cornell box, variance 0.8, gains from 90 steps on).
WORTH = 50.0
# Factor of WORTH where the image is denoised and blended: the denoiser removes most of the noise, but not the cache's
# error (measured, times WORTH: staircase2 at 11 and living-room-2 at 4 gain, the Cornell box at 1.3 loses).
WORTH_DENOISED = 2.5
# Stills with estimator=guided train for this share of their time at most.
GUIDED_SHARE = 0.25
# The learning rate of a still falls to this share of the first.
FINAL_RATE = 0.1


def train_still(image: ImageState, worth: float = WORTH) -> None:
    """Train before a still; the learning rate falls to ``FINAL_RATE`` of the first, so that the average converges.

    Args:
        image: The still; its number of samples or its time limit sets the number of training frames. Whether its paths
            may end in the cache, and may be guided, is decided here.
        worth: Gradient steps times relative variance of a path below which a still with a time limit is path traced.
    """
    cache, s, options = image.cache, image.settings, image.settings.image
    schedule, start = cache.schedule, time.perf_counter()
    if s.caching and options.denoise and not options.denoise_cache and options.view == "image":
        image.caching = image.guiding = False
        return None
    schedule.still, cache.guiding.allowed = True, image.guiding and (options.seconds > 0 or image.spp >= ENOUGH)
    if has_trial(image):
        return train_guide(image, FIRST_SHARE)
    done = 0.0
    while done < 1 and not cache.frozen:
        schedule.rate_factor = FINAL_RATE**done
        train_frame(image)
        if not s.caching and schedule.frame == 1 and image.stats[-1].noise < cache.guiding.calm:
            image.guiding = False
            break
        second = s.caching and len(image.stats) == 2 and schedule.frame == 2
        if options.seconds > 0 and second and not _pays(s, image.stats[1], worth):
            image.caching = False
            break
        done = _progress(image, done, time.perf_counter() - start)
    schedule.rate_factor, schedule.still = 1.0, False
    if options.seconds > 0 and schedule.frame == 1:
        image.caching = False  # A single training frame: too little to train, or to estimate whether it pays.
    image.guiding &= image.caching or not s.caching
    if image.caching:
        cache.trainer.settle()
    cache.guiding.settle()
    dr.sync_thread()
    image.seconds["train"] += time.perf_counter() - start


def _progress(image: ImageState, done: float, seconds: float) -> float:
    """Share of the training that is done after one more frame; ``seconds``: since it began."""
    s, options = image.settings, image.settings.image
    if options.seconds <= 0:
        return done + 1 / (options.warmup or int(min(WARMUP_FIRST + WARMUP_PER_SPP * image.spp, WARMUP_MOST)))
    share = options.train_share if s.caching else min(options.train_share, GUIDED_SHARE)
    return seconds / (share * options.seconds)


def _pays(settings: CacheSettings, stats: TrainingStats, worth: float) -> bool:
    """Whether a still with a time limit has time for enough steps; less noisy images need a more accurate cache."""
    options = settings.image
    steps = stats.steps * options.train_share * options.seconds / sum(stats.seconds.values())
    return not steps * stats.noise < worth * (WORTH_DENOISED if options.denoise else 1)
