"""Input of a report. N points; pictures [height, width, 3], first row at the top; radiance in any one unit."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lightwell.report.verdict import Verdict


@dataclass(frozen=True)
class PointComparison:
    """Held-out surface points, each with a view and a value of the variable that training did not use."""

    prediction: np.ndarray
    """[N, 3] radiance of the baked field."""
    half_a: np.ndarray
    """[N, 3] reference: mean over the first half of its paths."""
    half_b: np.ndarray
    """[N, 3] ... over the second half."""
    shape: np.ndarray
    """[N] index of the object, into ``objects``."""
    objects: Sequence[str]
    """Names of the objects of the scene."""
    weight: np.ndarray | None = None
    """[N] weight that makes means area-uniform; None: all the same."""


@dataclass(frozen=True)
class ViewPicture:
    """A view as it is shown: larger than the one that is scored, the reference denoised."""

    prediction: np.ndarray
    """[height, width, 3] radiance of the baked field, in the unit of the scored view."""
    reference: np.ndarray
    """[height, width, 3] reference without noise."""


@dataclass(frozen=True)
class ViewSurfaces:
    """What the pixels of a view show, to name places in it."""

    shape: np.ndarray
    """[height, width] index of the object; negative where there is no surface."""
    position: np.ndarray
    """[height, width, 3] metres."""
    objects: Sequence[str]
    """Names of the objects of the scene."""


@dataclass(frozen=True)
class ViewComparison:
    """A held-out picture."""

    name: str
    prediction: np.ndarray
    """[height, width, 3] radiance of the baked field."""
    half_a: np.ndarray
    """[height, width, 3] reference: mean over the first half of its paths."""
    half_b: np.ndarray
    """... over the second half."""
    regions: np.ndarray | None = None
    """[height, width] integer index of the expert, leaf or probe; negative where there is no surface; or None."""
    blend: np.ndarray | None = None
    """[height, width] bool: where regions are blended; drawn hatched."""
    caption: str = ""
    """One line about the view, for example the position of the light."""
    picture: ViewPicture | None = None
    """The view as it is shown, a whole multiple as large; None: the scored one."""
    surfaces: ViewSurfaces | None = None
    """None: places in the view have no names."""
    states: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Axis of a chart, such as ``hour of the day`` → what the view shows of it."""

    @property
    def reference(self) -> np.ndarray:
        """[height, width, 3] mean of both halves."""
        return np.asarray(0.5 * (np.asarray(self.half_a, np.float64) + self.half_b))

    @property
    def shown(self) -> ViewPicture:
        """The view as it is shown."""
        return self.picture or ViewPicture(self.prediction, self.reference)


@dataclass(frozen=True)
class MovedObject:
    """A ball in free air: what probes are for."""

    name: str
    prediction: np.ndarray
    """[height, width, 3] radiance by the light of the probes."""
    reference: np.ndarray
    """[height, width, 3] ... by path tracing."""
    mask: np.ndarray
    """[height, width] bool: pixels that show the ball."""
    unit: float = 1.0
    """Exposure unit of the picture."""

    def exposed(self, unit: float) -> MovedObject:
        """Set the exposure.

        Args:
            unit: Exposure unit.

        Returns:
            The ball with it.
        """
        return dataclasses.replace(self, unit=unit)


@dataclass(frozen=True)
class PageLink:
    """A page beside a report."""

    href: str
    """Path relative to the report."""
    text: str


@dataclass(frozen=True)
class ReportData:
    """One bake: its settings, cost and results."""

    scene: str
    field: str
    """Name of the representation."""
    preset: str
    seed: int
    points: PointComparison | None
    """None: the held-out points could not be scored."""
    views: Sequence[ViewComparison]
    bytes: int
    """Size of the learned light as stored: weights and textures."""
    macs_per_pixel: int
    """Multiply-adds of the shading graph per pixel."""
    seconds: dict[str, float]
    """Wall time by stage; at least ``trace`` and ``train``."""
    paths: int
    """Paths traced for training."""
    paths_per_second: float
    versions: dict[str, str]
    """Versions of the software that computed this, by name."""
    settings: dict[str, object] = dataclasses.field(default_factory=dict)
    """All settings of the bake; JSON values."""
    training: Sequence[tuple[float, float]] = ()
    """(seconds, relative error on validation samples)."""
    sweep: Sequence[tuple[float, float, float]] = ()
    """(position along the sweep of the variable in [0, 1] or hour of the day, relative error, noise floor)."""
    sweep_axis: str = "position along the sweep"
    """What the first number of ``sweep`` is."""
    asset_bytes: int | None = None
    """Size of the whole file."""
    warnings: Sequence[str] = ()
    licences: Sequence[str] = ()
    """One line for each work that the asset contains: title, author, licence."""
    facts: dict[str, object] = dataclasses.field(default_factory=dict)
    """Facts that the representation reports: numbers, histograms, curves over training; JSON values."""
    compressed_bytes: int | None = None
    """``bytes`` compressed by zlib."""
    parameters: int | None = None
    """Number of stored numbers."""
    fetches_per_pixel: int | None = None
    """Table entries that the shading graph reads per pixel."""
    quality: dict[str, object] | None = None
    """Figures of what a picture shows: psnr_db, flip, mottle, leak …, and ``bounds``; None: not measured."""
    verdict: Verdict | None = None
    """How good the bake is, in words."""
    links: Sequence[PageLink] = ()
    """Pages beside the report."""
    moved: Sequence[MovedObject] = ()
    """What probes light, in the views; empty without probes."""
    unit: float | None = None
    """Radiance of the unit S; None: 4 × the mean radiance of the held-out points."""
