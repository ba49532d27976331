"""State of one image while it is rendered."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

from lightwell.cache.checks import check_hits
from lightwell.cache.guide_selector import GuideSelector
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.reservoir_history import ReservoirHistory
from lightwell.cache.settings import CacheSettings
from lightwell.cache.training_stats import TrainingStats

# Samples per pixel from which 'auto' trains first and then renders with a frozen cache.
STILL_SPP = 8


@dataclass
class Rendered:
    """The samples of an image."""

    samples: int = 0
    """Samples per pixel that were rendered."""
    half: tuple[Any, float] | None = None
    """[H, W, 3] mean of about half of the samples, and their share, where the denoiser needs them."""
    cache_share: float | None = None
    """Mean weight of the cache's view in a denoised image, where it is blended."""


@dataclass
class ImageState:
    """What is rendered, and what was found out on the way."""

    settings: CacheSettings
    scene: Any
    sensor: Any
    cache: RadianceCache
    reservoirs: ReservoirHistory
    seed: int
    spp: int
    """Samples per pixel that were asked for."""
    caching: bool = False
    """Whether the paths of this image may end in the cache; False in a still too short for training."""
    guiding: bool = False
    """Whether the paths of this image are guided."""
    began: float = field(default_factory=time.perf_counter)
    """Time at which the rendering began, seconds."""
    stats: list[TrainingStats] = field(default_factory=list)
    """Training statistics, one entry per frame."""
    seconds: dict[str, float] = field(default_factory=lambda: {"train": 0.0, "trace": 0.0})
    """Wall time by stage."""
    rendered: Rendered = field(default_factory=Rendered)
    """The samples that were rendered."""
    pilot: GuideSelector | None = None
    """Test of the guide, where there was one."""

    def __post_init__(self) -> None:
        """Decide what the paths of the image use."""
        s = self.settings
        self.caching, self.guiding = s.caching, s.guided
        if s.caching and s.guiding.guide == "auto":
            # Frames have no pilot; with a denoiser, the time is better spent on samples than on a guide.
            self.guiding &= self.still and not s.image.denoise

    @property
    def still(self) -> bool:
        """Return whether all training precedes the image.

        Returns:
            True for a still, False for frames that train a little at every sample.
        """
        s = self.settings
        long = self.spp >= STILL_SPP or s.image.seconds > 0
        return s.learns and (s.image.mode == "still" or (s.image.mode == "auto" and long))


def keeps_half(image: ImageState) -> bool:
    """Return whether the mean of half of the samples is kept for the denoiser.

    Args:
        image: The image.

    Returns:
        True for a still that is blended with the view of a trained cache.
    """
    return image.settings.image.denoise_cache and image.still and image.caching


def train_frame(image: ImageState) -> None:
    """Train the cache of an image on one frame; a camera that sees no surface is refused.

    Args:
        image: The image; the statistics of the frame are added to it.
    """
    stats = image.cache.train_frame(image.scene, image.sensor, image.seed)
    if stats.changed:
        image.reservoirs.forget()
    image.stats.append(stats)
    if image.cache.schedule.frame == 1 and stats.steps == 0 and stats.hits >= 0:
        check_hits(stats.hits, image.sensor)
