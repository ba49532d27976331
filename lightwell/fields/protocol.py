"""The interface of a field: it prepares a scene, takes samples, fits, and lowers the result to a shading graph.

    state   = field.prepare(job)              check the settings; make the atlas or lattice; set the variable light
    samples = field.sample(state, role)       path-traced
    fit     = field.fit(state, role, samples)
    lowered = fit.lower()                     the shading graph that is written

A bake makes these four calls for each role of the state, then scores and writes the lowered graph. It uses nothing else
of a field.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from lightwell.core.progress import Progress
from lightwell.core.store import Store
from lightwell.core.work import Work, WorkPart
from lightwell.fields.request import Request
from lightwell.graph import Graph
from lightwell.graph.pictures import Fallback, Picture
from lightwell.scenes.lamps import LampGroup
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.samples import Query, SurfacePoints

Role = str
"""A part of the light: 'indirect' of the declared light, 'static' of the scene's own, or that of a further light."""

_FURTHER = "indirect-"


def further_role(light: str) -> Role:
    """Return the role of a further declared light.

    Args:
        light: Name of the light.

    Returns:
        The role.
    """
    return _FURTHER + light


def kind_of(role: Role) -> str:
    """Return what a role is called in an asset.

    Args:
        role: The role.

    Returns:
        'indirect' or 'static'.
    """
    return "indirect" if role.startswith(_FURTHER) else role


class GoodEnough(Exception):
    """Ends a training; what was learned so far is used."""


class Observer(Protocol):
    """Is told about trainings while they run."""

    def evaluated(self, role: Role, learner: Any) -> float:
        """Take note of an evaluation; ``GoodEnough`` ends the training.

        Args:
            role: Part of the light.
            learner: The learner, see ``lightwell.fields.base.Learner``.

        Returns:
            Seconds in which the training was paused.
        """

    def waited(self) -> float:
        """Wait while the training is paused; ``GoodEnough`` ends it. For trainings of which nothing can be shown yet.

        Returns:
            Seconds of waiting.
        """


@dataclass(frozen=True)
class Job:
    """The input of a field: scene, settings, work folder and progress."""

    scene: Scene
    request: Request
    options: Any
    """Instance of the field's ``Options``."""
    work: Work
    """Folder of intermediate results until the bake is written."""
    progress: Progress
    shared: bool = False
    """Whether other fields learn from the same samples: none then depend on the fit, half of the budget traces them,
    and a training that takes longer than planned is stopped."""
    observer: Observer | None = None
    """Is told about the training; None: nobody looks."""

    def wait(self) -> float:
        """Wait while the observer pauses the training, which is left out of the time of the bake.

        ``GoodEnough`` from the observer ends the training.

        Returns:
            Seconds of waiting.
        """
        if self.observer is None:
            return 0.0
        seconds = self.observer.waited()
        self.work.skip(seconds)
        return seconds


@dataclass
class State:
    """A prepared scene. Fields derive classes from it for what they keep between their stages."""

    job: Job
    scene: Scene
    """The scene that is traced and scored; a field may have added a light."""
    variable: Variable | None
    """Ranges of the variable light; None: no light varies."""
    roles: tuple[Role, ...]
    """Parts of the light that are learned, in this order; the report's headline figures are those of the first."""
    warnings: list[str] = field(default_factory=list)
    """Notes of the field, for the report."""
    more: tuple[Variable, ...] = field(default=(), kw_only=True)
    """Further lights that vary, each with a field of its own: light adds up."""
    looked: Variable | None = field(default=None, kw_only=True)
    """Where people look, the same for all roles, so that they share points and rays; None: where their light may be."""
    lamps: tuple[LampGroup, ...] = field(default=(), kw_only=True)
    """Groups of the scene's own lights that have a switch each; none: their light cannot be changed."""

    def for_role(self, role: Role) -> State:
        """Return the state for the samples and the field of a role.

        Args:
            role: One of ``roles``.

        Returns:
            The state, whose variable is the light of the role.
        """
        found = next((light for light in self.more if further_role(light.name) == role), None)
        return self if found is None else replace(self, variable=found)

    @property
    def shipped(self) -> Scene:
        """Return the scene as it is written: with the second texture coordinates of an atlas, for example."""
        return self.scene

    def finished(self, fits: Mapping[Role, Fit]) -> ReBake | None:
        """Return the summary of an incremental bake.

        Args:
            fits: The fit of each role.

        Returns:
            The summary that replaces the report; None for a full bake, which has a report.
        """
        return None


@dataclass(frozen=True)
class Shown:
    """The light under which a bake is shown first."""

    light: np.ndarray
    """[3] position of the light, metres, or direction towards the sun."""
    intensity: np.ndarray
    """[3] candela or lux, by colour."""


@dataclass(frozen=True)
class ExtraFile:
    """A file that is written beside the asset."""

    name: str
    media_type: str
    write: Callable[[Path], None]
    """Writes it, whole or not at all, to a path."""


@dataclass(frozen=True)
class ReBake:
    """The summary of an incremental bake, which replaces the report."""

    shown: Shown
    facts: dict[str, Any]
    """Content of ``rebake.json``."""
    lines: list[str]
    """The same in words."""
    page: bool = False
    """Whether ``index.html`` is written as well."""


@dataclass(frozen=True)
class Lowered:
    """The part of a fit that is written to the asset."""

    graph: Graph
    """What every runtime evaluates; its output ``radiance`` is divided by the reflectance."""
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    """Buffers of the graph that are stored as pictures."""
    fallback: Fallback | None = None
    """An ordinary light map for viewers that know no more."""
    name: str = ""
    """Of the field in the asset; empty: its role."""
    frame: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Inputs of the graph that are the same at all points, such as ``lamps``, as the scene has them; [C] each."""
    probes: Graph | None = None
    """Shading graph of the same light in the air, for what is added to the scene or moves; None: there is none."""


@dataclass(frozen=True)
class Traced:
    """The cost of the samples of a fit."""

    paths: int = 0
    """Light paths."""
    dropped: int = 0
    """... of which were NaN or infinite and left out."""
    samples: int = 0
    """Training samples."""
    rate: float = 0.0
    """Light paths per second as measured without finding surface points; 0: not measured."""
    each: int | None = None
    """Light paths of a sample, as they were traced: its own, or the rays that all samples of its point share; None: as
    many as were asked for."""


@dataclass(frozen=True)
class Training:
    """How a fit was trained."""

    seconds: float = 0.0
    """Wall time, what is made of the samples before the first step included."""
    steps: int = 0
    curve: list[tuple[float, float]] = field(default_factory=list)
    """(seconds of training, validation error)."""
    cut: bool = False
    """Whether the time ran out before the planned steps."""


class Fit(Protocol):
    """A finished fit of one role."""

    unit: float
    """Radiance unit S: targets were divided by it."""
    traced: Traced
    plan: dict[str, Any]
    """Counts that the budget bought; JSON values."""
    training: Training
    facts: dict[str, Any]
    """Facts about the representation for the report; JSON values, NumPy numbers included."""

    def query(self, points: SurfacePoints, light: np.ndarray) -> Query:
        """Return the inputs of the graph at surface points.

        Args:
            points: N surface points.
            light: [3] or [N, 3] position of the light in metres, or direction towards the sun.

        Returns:
            N queries.
        """

    def lower(self) -> Lowered:
        """Return the shading graph that is written, its buffers rounded to their stored types.

        Returns:
            The graph and what is stored beside it.
        """

    note: str
    """One line about ``files`` for the terminal, known once they were asked for; or nothing."""

    def files(self, glb: Path, shown: Shown, store: Store | None = None) -> list[ExtraFile]:
        """List the files that are written beside the asset, and store what an incremental bake starts from.

        Args:
            glb: Path of the asset.
            shown: The light under which the bake is shown first.
            store: Where to keep what an incremental bake starts from; None: it is not kept.

        Returns:
            The files, not yet written.
        """


class Field(Protocol):
    """A learned representation. ``lightwell.fields.registry`` finds it by name, also in other distributions."""

    name: str
    Options: type
    """Dataclass of the options that only this field has; see ``lightwell.core.options``."""
    presets: Mapping[str, Any]
    """Settings by name, the default first."""
    shares: str
    """Fields with the same word here learn from the same samples when they are compared."""

    def prepare(self, job: Job) -> State:
        """Check the settings, find the variable light, and make what sampling needs. Mistakes of the user are
        ``ValueError``.

        Args:
            job: Scene and settings.

        Returns:
            The prepared scene.
        """

    def sample(self, state: State, role: Role) -> Any:
        """Trace the samples of a role, or read those that an interrupted bake has kept.

        Args:
            state: The prepared scene.
            role: The part of the light to sample, one of ``state.roles``.

        Returns:
            Samples of the field's own type.
        """

    def fit(self, state: State, role: Role, samples: Any, part: WorkPart | None = None) -> Fit:
        """Fit the field to samples.

        Args:
            state: The prepared scene.
            role: The part of the light that the samples hold.
            samples: Samples from ``sample`` of this field, or of another with the same ``shares``.
            part: Part of the bake that stores checkpoints, where several fields are fitted in one run; None: the
                field chooses it.

        Returns:
            The finished fit.
        """
