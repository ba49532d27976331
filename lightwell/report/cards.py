"""The main figures of a report: each with its meaning, and beside it that of the bake before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from lightwell.report.numbers import amount, digits, duration, grouped, percent

HIDDEN = "not measurable (reference noise)"
# Keys of report.json that a later report in the same folder shows beside its own.
COMPARED = (
    *("scene", "field", "preset", "seed", "verdict", "points", "relative_error", "relative_error_median"),
    *("relative_error_p95", "noise_floor", "psnr_db", "psnr_ceiling_db", "flip", "energy_ratio", "quality", "bytes"),
    *("asset_bytes", "macs_per_pixel", "fetches_per_pixel", "seconds", "paths", "paths_per_second"),
)


@dataclass(frozen=True)
class Card:
    """A figure."""

    term: str
    """Name in the glossary."""
    value: str
    why: str
    """One line about the value."""
    before: str = ""
    """The value of the bake before; empty: there is none, or it is the same."""
    words: bool = False
    """The value is not a number."""


def cards(numbers: Mapping[str, Any]) -> list[Card]:
    """Choose the main figures of a report.

    Args:
        numbers: Content of ``report.json``.

    Returns:
        The figures that were measured, in order.
    """
    before = {card.term: card.value for card in _all(numbers["previous"] or {})}
    return [replace(c, before=before[c.term]) if before.get(c.term, c.value) != c.value else c for c in _all(numbers)]


def _all(numbers: Mapping[str, Any]) -> Iterator[Card]:
    if not numbers:
        return
    if numbers["relative_error"] is not None:
        keys = ("relative_error_median", "relative_error_p95", "noise_floor")
        median, most, floor = (percent(numbers[key]) for key in keys)
        why = f"Median {median}; 95\u202f% below {most}. Noise floor {floor}, over {grouped(numbers['points'])} points."
        yield Card("Relative error", percent(numbers["relative_error"]), why)
    yield from _of_pictures(numbers)
    if numbers["energy_ratio"] is not None:
        ratio = digits(numbers["energy_ratio"], 4)
        yield Card("Energy ratio", ratio, "Learned over reference light; 1: none is lost or added.")
    whole = f" The whole asset: {amount(numbers['asset_bytes'], 'B')}." if numbers["asset_bytes"] else ""
    yield Card("Size", amount(numbers["bytes"], "B"), f"Weights and textures of the learned light.{whole}")
    fetches = numbers["fetches_per_pixel"]
    reads = f", and {grouped(fetches)} table reads" if fetches else ""
    yield Card("Cost per pixel", f"{amount(numbers['macs_per_pixel'])} MAC", f"Multiply-adds of the network{reads}.")
    stages = " · ".join(f"{name} {duration(t)}" for name, t in numbers["seconds"].items() if name != "total")
    yield Card("Time to bake", duration(numbers["seconds"]["total"]), stages)
    if numbers["paths"]:  # light maps do not count them
        yield Card("Paths", amount(numbers["paths"]), f"{amount(numbers['paths_per_second'])} per second.")


def _of_pictures(numbers: Mapping[str, Any]) -> Iterator[Card]:
    """Figures of what the pictures show."""
    quality = numbers["quality"] or {}
    bounds = quality.get("bounds", {})
    ceiling = f"A perfect prediction would score {digits(numbers['psnr_ceiling_db'])}\u202fdB"
    if quality.get("psnr_db") is not None:
        least, why = "", "Of the displayed indirect light."
        if "psnr_db" in bounds:
            least, why = "≥\u202f", "A lower bound: the noise of the reference is larger than the error."
        yield Card("Noise-free PSNR", f"{least}{digits(quality['psnr_db'])}\u202fdB", why)
    elif numbers["psnr_db"] is not None:
        yield Card("PSNR", f"{digits(numbers['psnr_db'])}\u202fdB", f"{ceiling}.")
    if quality.get("flip") is not None:
        alone = f"Direct light alone: {digits(quality['flip_direct'])}."
        yield Card("FLIP, whole picture", digits(quality["flip"]), alone)
    if quality.get("mottle") is not None:
        yield Card("Mottle", digits(quality["mottle"]), "Blotches on smooth lit surfaces; 0 is none.")
    elif "mottle" in bounds:
        yield Card("Mottle", HIDDEN, f"At most {digits(bounds['mottle'])}.", words=True)
    if quality.get("leak") is not None:
        why = "Wrong light on the darkest quarter of the surface, over the mean of all."
        if "leak" in bounds:
            why += f" Not more than the noise of the reference; at most {percent(bounds['leak'])}."
        yield Card("Leak", percent(quality["leak"]), why)
