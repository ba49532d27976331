"""Unbiased stills with a time limit: how long the guide trains, and whether it is used at all.

The guide trains for a small share of the time. Then passes of one sample per pixel are rendered without and with it.
Where the guide loses clearly, the rest is path traced; else it trains on and is compared again. All passes are part of
the image. Each kind of passes is weighted by the inverse of its measured variance, so that passes of the worse kind do
not add noise; the weight is one number for the whole image, which no single pixel determines.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.guide_selector import ENOUGH, GuideSelector
from lightwell.cache.image_state import ImageState, train_frame

# Shares of the still's time at which the guide is compared; it trains until then. A guide of fewer frames is not tried.
FIRST_SHARE, SECOND_SHARE, LEAST_FRAMES = 0.03, 0.1, 3
# Passes of each kind in a comparison.
PASSES = 2
# The guide trains on after the first comparison where its gain exceeds PROMISING: it grows with training (measured at
# 80^2 to 96^2, after 4 and 12 or 16 frames: veach-ajar from 0.83 to 1.36, veach-bidir from 0.76 to 0.99, staircase2
# from 0.53 to 0.62). It is used where the gain exceeds WINNING.
PROMISING, WINNING = 0.8, 1.1

Trace = Callable[[bool, int], Any]
"""Renders one sample per pixel: whether the guide is used, and number of the sample; returns the image block."""


@dataclass
class HeldPass:
    """A pass of a comparison, until its weight is known."""

    block: Any
    """Image block with the sums."""
    variance: float = float("nan")
    """Relative variance of its kind."""


def has_trial(image: ImageState) -> bool:
    """Return whether the guide of an image is tried in this way.

    Args:
        image: The image.

    Returns:
        True for an unbiased still with a time limit and guide=auto.
    """
    s = image.settings
    return image.still and image.guiding and not s.caching and s.image.seconds > 0 and s.guiding.guide == "auto"


def train_guide(image: ImageState, share: float) -> None:
    """Train the guide until a share of the still's time has passed; an image with little noise is left without one.

    The first frames may compile kernels: ``LEAST_FRAMES`` may take twice the share.

    Args:
        image: The still.
        share: Share of the time limit, in (0, 1).
    """
    cache, start = image.cache, time.perf_counter()
    cache.schedule.still = True
    while image.guiding and not cache.frozen:
        if _elapsed(image) >= (share if len(image.stats) >= LEAST_FRAMES else 2 * share):
            break
        train_frame(image)
        if cache.schedule.frame == 1 and image.stats[-1].noise < cache.guiding.calm:
            image.guiding = False
    cache.schedule.still = False
    cache.guiding.settle()
    dr.sync_thread()
    image.seconds["train"] += time.perf_counter() - start


class GuideTrial:
    """Comparison of passes without and with the guide of one still."""

    def __init__(self, image: ImageState, trace: Trace) -> None:
        """Compare nothing yet.

        Args:
            image: The still, whose guide has trained until ``FIRST_SHARE``.
            trace: Renders a pass.
        """
        self.image, self.trace = image, trace
        self.selector = GuideSelector()
        self.held: dict[bool, list[HeldPass]] = {False: [], True: []}
        """Passes without and with the guide."""

    def run(self) -> None:
        """Compare, train on where it is promising, and decide whether the image is guided from here on."""
        image = self.image
        gain = self._gain() if self._begins() else 0.0
        if gain > PROMISING and not image.cache.frozen:
            image.guiding, frames = True, len(image.stats)
            train_guide(image, SECOND_SHARE)
            # Where the first comparison took until then, there is no other guide to compare.
            if len(image.stats) > frames:
                self.selector.forget_guided()
                gain = self._gain()
        image.guiding = gain > WINNING

    def blocks(self) -> list[Any]:
        """Weight the passes by the inverse of their variance, relative to the kind that the image continues with.

        Returns:
            Image blocks to be added to the film.
        """
        kept = [each.variance for each in self.held[self.image.guiding]]
        # Noise of 0 says that the passes found no light, not that they are exact.
        reference = kept[-1] if kept and kept[-1] > 0 else float("nan")
        return [
            weighted(each.block, reference / each.variance if each.variance > 0 else float("nan"))
            for kind in self.held.values() for each in kind
        ]  # fmt: skip

    def _begins(self) -> bool:
        """Render the plain passes; whether the guide has data and the still has time for ``ENOUGH`` samples."""
        image, guide = self.image, self.image.cache.guiding
        if guide.guide is None or guide.table is None or guide.table.frames < LEAST_FRAMES:
            return False
        for _ in range(PASSES):
            self._add(False)
        return min(self.selector.seconds[False]) * ENOUGH < image.settings.image.seconds

    def _gain(self) -> float:
        """Render guided passes, and compare; 0 where the time is over."""
        for _ in range(PASSES):
            if _elapsed(self.image) >= 1:
                return 0.0
            self._add(True)
        plain, guided = self.selector.variances()
        for each in self.held[False]:
            each.variance = plain
        for each in self.held[True][-PASSES:]:
            each.variance = guided
        gain = self.selector.gain(True)
        return gain if np.isfinite(gain) else 0.0

    def _add(self, guided: bool) -> None:
        """Render one pass."""
        start = time.perf_counter()
        block = self.trace(guided, len(self.held[guided]))
        tensor = block.tensor()
        dr.eval(tensor)
        dr.sync_thread()
        self.selector.add(guided, np.array(tensor), time.perf_counter() - start)
        self.held[guided].append(HeldPass(block))


def weighted(block: Any, weight: float) -> Any:
    """Multiply the sums of an image block, the weights included.

    Args:
        block: Image block.
        weight: Factor, > 0; 1 where it is not finite.

    Returns:
        New image block.
    """
    if not (np.isfinite(weight) and weight > 0):
        return block
    return mi.ImageBlock(block.tensor() * weight, block.offset(), block.rfilter())


def _elapsed(image: ImageState) -> float:
    """Share of the time limit that has passed."""
    return (time.perf_counter() - image.began) / image.settings.image.seconds
