"""The number of paths of the reference that a bake is scored against."""

from __future__ import annotations

from dataclasses import dataclass

# Streams of random numbers that evaluation never shares with training.
EVALUATION_SEED = 0x5EED
# Pictures for display have so many times the width and height of the views that are scored: 672 x 420 by default.
PICTURE_SCALE = 3
# Where other fields share the reference, its time is this share of the budget of each, within bounds in seconds.
SHARED_SHARE, SHARED_LEAST, SHARED_MOST = 0.4, 12.0, 240.0
# Seconds of scoring that trace nothing (compiling, metrics, denoising, writing), and the share of the rest for tracing.
UNTRACED, TRACED_SHARE = 6.0, 0.8
# Least and most seconds of tracing the reference of a bake.
LEAST, MOST = 4.0, 240.0
# A picture is late after so many times its share of the time; the others have at least so many paths per pixel.
LATE, FEWEST_SPP = 1.25, 4
# Shares of the paths: points, pixels, pictures, sweep; the rest is for patches, which are traced as the points are.
POINT_SHARE, PIXEL_SHARE, PICTURE_SHARE, SWEEP_SHARE = 0.2, 0.2, 0.4, 0.1


@dataclass(frozen=True)
class ReferenceBudget:
    """Sizes and path counts of the reference; its noise floor is reported beside every error."""

    points: int = 4096
    point_paths: int = 1024
    lights: int = 32
    pixel_paths: int = 192
    picture_spp: int = 32
    """Of the pictures for display, which are denoised."""
    picture_seconds: float = 0.0
    """Time for all of them; 0: any time."""
    sweep: int = 16
    sweep_points: int = 256
    sweep_paths: int = 256

    @staticmethod
    def within(seconds: float, paths_per_second: float, pixels: int, roles: int = 1) -> ReferenceBudget:
        """Choose path counts for a given time.

        Args:
            seconds: Time for the reference.
            paths_per_second: Measured rate.
            pixels: Number of pixels of all views.
            roles: Parts of the light that are traced at points and pixels.

        Returns:
            The budget.
        """
        # One more role adds what points, pixels and pictures cost.
        budget = seconds * paths_per_second / (1 + (roles - 1) * (POINT_SHARE + PIXEL_SHARE + PICTURE_SHARE))
        even = lambda paths, least=8: max(int(paths) // 2 * 2, least)  # noqa: E731
        return ReferenceBudget(
            point_paths=min(even(POINT_SHARE * budget / 4096), 8192),
            pixel_paths=min(even(PIXEL_SHARE * budget / pixels), 4096),
            picture_spp=min(even(PICTURE_SHARE * budget / (PICTURE_SCALE**2 * pixels), 2), 1024),
            picture_seconds=PICTURE_SHARE * seconds,
            sweep_paths=min(even(SWEEP_SHARE * budget / (16 * 256)), 4096),
        )

    def further_spp(self, seconds: float, pictures: int) -> int:
        """Choose the paths of pictures for display from the time of the first one.

        Pictures show the sky, leaves and glass, which points on surfaces, of which the rate is known, have less of.

        Args:
            seconds: Time of the first picture.
            pictures: Number of pictures.

        Returns:
            Paths per pixel of the others, at most those of the first one.
        """
        share = self.picture_seconds / pictures
        if not self.picture_seconds or seconds <= LATE * share:
            return self.picture_spp
        return min(max(int(self.picture_spp * share / seconds) // 2 * 2, FEWEST_SPP), self.picture_spp)


def reference_seconds(left: float) -> float:
    """Compute the time of the reference.

    Args:
        left: Seconds of the budget that are left for scoring, pictures and writing.

    Returns:
        Seconds of tracing.
    """
    return min(max(TRACED_SHARE * (left - UNTRACED), LEAST), MOST)


def shared_seconds(seconds: float) -> float:
    """Compute the time of the reference of a comparison.

    Args:
        seconds: Budget of each field.

    Returns:
        Seconds of tracing.
    """
    return min(max(seconds * SHARED_SHARE, SHARED_LEAST), SHARED_MOST)
