"""The number of paths of the reference that a bake is scored against."""

from __future__ import annotations

from dataclasses import dataclass

# Streams of random numbers that evaluation never shares with training.
EVALUATION_SEED = 0x5EED
# Pictures for display have so many times the width and height of the views that are scored: 672 x 420 by default.
PICTURE_SCALE = 3
# The reference of the report may take this share of the budget, within these bounds, in seconds.
EVALUATION_SHARE, EVALUATION_LEAST, EVALUATION_MOST = 0.4, 12.0, 240.0


@dataclass(frozen=True)
class ReferenceBudget:
    """Sizes and path counts of the reference; its noise floor is reported beside every error."""

    points: int = 4096
    point_paths: int = 1024
    lights: int = 32
    pixel_paths: int = 192
    picture_spp: int = 32
    """Of the pictures for display, which are denoised."""
    sweep: int = 16
    sweep_points: int = 256
    sweep_paths: int = 256

    @staticmethod
    def within(seconds: float, paths_per_second: float, pixels: int) -> ReferenceBudget:
        """Choose path counts for a given time.

        Args:
            seconds: Time for the reference.
            paths_per_second: Measured rate.
            pixels: Number of pixels of all views.

        Returns:
            The budget.
        """
        budget = seconds * paths_per_second
        even = lambda paths: max(int(paths) // 2 * 2, 8)  # noqa: E731
        return ReferenceBudget(
            point_paths=min(even(0.20 * budget / 4096), 8192),
            pixel_paths=min(even(0.45 * budget / pixels), 4096),
            picture_spp=min(even(0.25 * budget / (PICTURE_SCALE**2 * pixels)), 1024),
            sweep_paths=min(even(0.10 * budget / (16 * 256)), 4096),
        )

    @staticmethod
    def of_budget(seconds: float, paths_per_second: float, pixels: int) -> ReferenceBudget:
        """Choose path counts in proportion to the time of tracing and training.

        Args:
            seconds: Time of tracing and training.
            paths_per_second: Measured rate.
            pixels: Number of pixels of all views.

        Returns:
            The budget.
        """
        share = min(max(seconds * EVALUATION_SHARE, EVALUATION_LEAST), EVALUATION_MOST)
        return ReferenceBudget.within(share, paths_per_second, pixels)
