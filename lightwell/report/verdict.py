"""Rate a bake in one sentence, from its metrics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

Level = Literal["good", "fair", "poor"]
LEVELS: tuple[Level, ...] = ("good", "fair", "poor")
NOT_JUDGED_NOISE = "not judged: the noise of the reference hides every figure; a longer --truth would tell"
# A view whose PSNR is this far below the median of the views is named, decibels.
WORSE_DB = 3.0
# FLIP of the whole picture, direct light included, up to which a fault of the indirect light can hardly be seen. Two of
# the 37 scenes of docs/zoo.md lie below it (0.005, 0.002): their pictures look alike, though the indirect light alone
# has blotches. The next one, 0.016, has faults that are seen.
HARDLY_SEEN_FLIP = 0.01


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
    title: str
    """Name of the metric in text."""
    of_indirect: bool = False
    """Whether it is measured on the indirect light alone and counts only as far as the whole picture shows it."""

    def level(self, value: float) -> Level:
        """Grade a value.

        Args:
            value: The metric.

        Returns:
            "good", "fair" or "poor".
        """
        sign = 1 if self.higher_is_better else -1
        return "good" if sign * value >= sign * self.good else "fair" if sign * value >= sign * self.fair else "poor"


DIFFERS = "the learned light differs visibly from the reference"
HARDLY_SEEN = "the indirect light alone differs from the reference, the whole picture hardly"
# The thresholds of "good" are less strict than the required medians over many scenes (36 dB, FLIP 0.06, mottle 0.03,
# leak 0.5 %); those of "fair" are the required 90th percentiles (31 dB, 0.12, 0.08, 2 %).
CRITERIA = (
    Criterion("leak", 0.01, 0.02, False, "dark places glow", "leak"),
    Criterion("mottle", 0.05, 0.08, False, "smooth surfaces show blotches", "mottle", of_indirect=True),
    Criterion("psnr_db", 34.0, 31.0, True, DIFFERS, "PSNR", of_indirect=True),
    Criterion("flip", 0.08, 0.12, False, DIFFERS, "FLIP"),
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
    bounds: Mapping[str, float] | None = None,
) -> Verdict:
    """Rate a bake in words.

    Args:
        figures: Name of a criterion → its value; None or absent: not measured. Where "flip" is at most
            ``HARDLY_SEEN_FLIP``, faults of the indirect light alone are at most "fair".
        views: Names of the scored views.
        view_psnr_db: PSNR of each view in decibels, None where a view shows no indirect light.
        cure: Option that the user can try next; empty: none.
        bounds: Bounds of the criteria that the noise of the reference hides. One that is good at its bound counts as
            good; another is named as not measurable, and the level is then at most "fair".

    Returns:
        The level, which is that of the worst criterion, and the sentence.
    """
    bounds = bounds or {}
    known = {**figures, **bounds}
    graded = [_grade(c, value, known.get("flip")) for c in CRITERIA if (value := known.get(c.name)) is not None]
    hidden = [c.title for c, found in graded if c.name in bounds and found != "good"]
    graded = [(c, found) for c, found in graded if c.title not in hidden]
    if not graded:
        return Verdict("poor", NOT_JUDGED_NOISE if hidden else "not judged: no view shows indirect light")
    level = max((found for _, found in graded), key=LEVELS.index)
    wrong = list(dict.fromkeys(c.seen for c, found in graded if found == level and level != "good"))
    worst = _worst_view(views, view_psnr_db)
    told = f"{level}: {' and '.join(wrong[:2])}" if wrong else "good in what can be measured" if hidden else level
    parts = [told, worst, f"{cure} would help" if cure and (wrong or worst) else ""]
    if hidden:
        parts.append(f"{' and '.join(hidden)} not measurable (reference noise), a longer --truth would tell")
    return Verdict("fair" if hidden and level == "good" else level, "; ".join(filter(None, parts)))


def _grade(criterion: Criterion, value: float, flip: float | None) -> tuple[Criterion, Level]:
    """Grade a value; a fault that the whole picture hardly shows, by its FLIP, is at most "fair" and named so."""
    level = criterion.level(value)
    if criterion.of_indirect and level != "good" and flip is not None and flip <= HARDLY_SEEN_FLIP:
        return replace(criterion, seen=HARDLY_SEEN), "fair"
    return criterion, level


def _worst_view(views: Sequence[str], psnr_db: Sequence[float | None]) -> str:
    """Name the view that is much worse than the others; empty when none is."""
    known = [(value, name) for value, name in zip(psnr_db, views) if value is not None]
    if len(known) < 2:
        return ""
    worst, name = min(known)
    gap = float(np.median([value for value, _ in known])) - worst
    return f"the view '{name}' is {gap:.0f} dB worse than the others" if gap >= WORSE_DB else ""
