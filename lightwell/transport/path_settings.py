"""Settings and counts of path tracing."""

from __future__ import annotations

from dataclasses import dataclass

# Lanes of one launch, as many as a shard has: enough for kernels that take longer by far than to record them, few
# enough for some hundred megabytes.
LAUNCH = 1 << 21


@dataclass
class PathReport:
    """Path counts of radiance queries; pass one in to read it afterwards. Counts add up over calls."""

    paths: int = 0
    """Paths traced."""
    dropped: int = 0
    """Paths left out of the means because their value was NaN or infinite."""
    points: int = 0
    """Points with a half that had no finite path; their mean is NaN."""


@dataclass(frozen=True)
class PathSettings:
    """Settings of path tracing."""

    paths: int
    """Paths per point, even, ≥ 2."""
    seed: int
    max_depth: int
    rr_depth: int
    include_direct: bool
    connections: int
    launch: int = LAUNCH
    """Paths that are traced at a time, ≥ 2; bounds memory."""
    past_mirrors: bool = False
    """Mirrors, glass and holes behind the first vertex are passed without counting as a vertex."""
