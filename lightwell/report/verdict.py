"""One line of words on how good a bake is, from its figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Level = Literal["good", "fair", "poor"]
LEVELS: tuple[Level, ...] = ("good", "fair", "poor")
# A view that is so many decibels below the median of the views is named.
WORSE_DB = 3.0


@dataclass(frozen=True)
class Criterion:
    """A figure with the bars of its levels and what a person sees where it is missed."""

    name: str
    """Key of the figure."""
    good: float
    """Bar of "good"."""
    fair: float
    """Bar of "fair"."""
    higher_is_better: bool
    seen: str
    """What is wrong with the picture, in words."""

    def level(self, value: float) -> Level:
        """Grade a value.

        Args:
            value: The figure.

        Returns:
            "good", "fair" or "poor".
        """
        sign = 1 if self.higher_is_better else -1
        return "good" if sign * value >= sign * self.good else "fair" if sign * value >= sign * self.fair else "poor"


# The bars of "good" leave room below the medians that are asked for over many scenes (36 dB, FLIP 0.06, mottle 0.03,
# leak 0.5 %); those of "fair" are their 90th percentiles (31 dB, 0.12, 0.08, 2 %).
CRITERIA = (
    Criterion("leak", 0.01, 0.02, False, "dark places glow"),
    Criterion("mottle", 0.05, 0.08, False, "smooth surfaces show blotches"),
    Criterion("psnr_db", 34.0, 31.0, True, "the learned light differs visibly from the reference"),
    Criterion("flip", 0.08, 0.12, False, "the pictures differ visibly from the reference"),
)


@dataclass(frozen=True)
class Verdict:
    """How good a bake is."""

    level: Level
    text: str
    """One sentence: the level, what is wrong, the worst view, the cure."""


def verdict(
    figures: Mapping[str, float | None],
    views: Sequence[str] = (),
    view_psnr_db: Sequence[float | None] = (),
    cure: str = "--quality best",
) -> Verdict:
    """Say in words how good a bake is.

    Args:
        figures: Name of a criterion to its value; None or absent: not measured.
        views: Names of the scored views.
        view_psnr_db: PSNR of each view in decibels, None where a view shows no indirect light.
        cure: What the reader can try next; empty: nothing.

    Returns:
        The level, which is that of the worst criterion, and the sentence.
    """
    graded = [(c, c.level(value)) for c in CRITERIA if (value := figures.get(c.name)) is not None]
    if not graded:
        return Verdict("poor", "not judged: no view shows indirect light")
    level = max((found for _, found in graded), key=LEVELS.index)
    wrong = [c.seen for c, found in graded if found == level and level != "good"]
    parts = [f"{level}: {' and '.join(wrong[:2])}" if wrong else level]
    if worst := _worst_view(views, view_psnr_db):
        parts.append(worst)
    if cure and (level != "good" or worst):
        parts.append(f"{cure} would help")
    return Verdict(level, "; ".join(parts))


def _worst_view(views: Sequence[str], psnr_db: Sequence[float | None]) -> str:
    """Which view is much worse than the others; empty when none is."""
    known = [(value, name) for value, name in zip(psnr_db, views) if value is not None]
    if len(known) < 2:
        return ""
    worst, name = min(known)
    gap = float(np.median([value for value, _ in known])) - worst
    return f"the view '{name}' is {gap:.0f} dB worse than the others" if gap >= WORSE_DB else ""
