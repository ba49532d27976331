"""Rate a bake in one sentence, from its metrics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Level = Literal["good", "fair", "poor"]
LEVELS: tuple[Level, ...] = ("good", "fair", "poor")
# A view whose PSNR is this far below the median of the views is named, decibels.
WORSE_DB = 3.0


@dataclass(frozen=True)
class Criterion:
    """A metric, the thresholds of its levels, and the visible fault where they are missed."""

    name: str
    """Key of the metric."""
    good: float
    """Threshold of "good"."""
    fair: float
    """Threshold of "fair"."""
    higher_is_better: bool
    seen: str
    """Description of the visible fault."""

    def level(self, value: float) -> Level:
        """Grade a value.

        Args:
            value: The metric.

        Returns:
            "good", "fair" or "poor".
        """
        sign = 1 if self.higher_is_better else -1
        return "good" if sign * value >= sign * self.good else "fair" if sign * value >= sign * self.fair else "poor"


# The thresholds of "good" are less strict than the required medians over many scenes (36 dB, FLIP 0.06, mottle 0.03,
# leak 0.5 %); those of "fair" are the required 90th percentiles (31 dB, 0.12, 0.08, 2 %).
CRITERIA = (
    Criterion("leak", 0.01, 0.02, False, "dark places glow"),
    Criterion("mottle", 0.05, 0.08, False, "smooth surfaces show blotches"),
    Criterion("psnr_db", 34.0, 31.0, True, "the learned light differs visibly from the reference"),
    Criterion("flip", 0.08, 0.12, False, "the learned light differs visibly from the reference"),
)


@dataclass(frozen=True)
class Verdict:
    """Rating of a bake."""

    level: Level
    text: str
    """One sentence: the level, what is wrong, the worst view, the cure."""


def verdict(
    figures: Mapping[str, float | None],
    views: Sequence[str] = (),
    view_psnr_db: Sequence[float | None] = (),
    cure: str = "--quality best",
) -> Verdict:
    """Rate a bake in words.

    Args:
        figures: Name of a criterion → its value; None or absent: not measured.
        views: Names of the scored views.
        view_psnr_db: PSNR of each view in decibels, None where a view shows no indirect light.
        cure: Option that the user can try next; empty: none.

    Returns:
        The level, which is that of the worst criterion, and the sentence.
    """
    graded = [(c, c.level(value)) for c in CRITERIA if (value := figures.get(c.name)) is not None]
    if not graded:
        return Verdict("poor", "not judged: no view shows indirect light")
    level = max((found for _, found in graded), key=LEVELS.index)
    wrong = list(dict.fromkeys(c.seen for c, found in graded if found == level and level != "good"))
    parts = [f"{level}: {' and '.join(wrong[:2])}" if wrong else level]
    if worst := _worst_view(views, view_psnr_db):
        parts.append(worst)
    if cure and (level != "good" or worst):
        parts.append(f"{cure} would help")
    return Verdict(level, "; ".join(parts))


def _worst_view(views: Sequence[str], psnr_db: Sequence[float | None]) -> str:
    """Name the view that is much worse than the others; empty when none is."""
    known = [(value, name) for value, name in zip(psnr_db, views) if value is not None]
    if len(known) < 2:
        return ""
    worst, name = min(known)
    gap = float(np.median([value for value, _ in known])) - worst
    return f"the view '{name}' is {gap:.0f} dB worse than the others" if gap >= WORSE_DB else ""
