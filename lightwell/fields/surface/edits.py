"""The incremental bake of a surface field: ``lightwell bake SCENE --rebake OLD``.

What has changed is found by hashes of the scene's parts. Of the kept samples, those that could notice it are traced
again (``transport.noticed``), the others keep their bytes; training then goes on from the weights of OLD, with 4 % of
its steps. A role that nothing touches keeps its weights. Nothing is measured against a reference: a full bake does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.core.formats import ARRAYS
from lightwell.core.store import Store
from lightwell.core.work import store_of
from lightwell.fields.base import FieldSetup, Learner, to_learn
from lightwell.fields.protocol import Fit, Job, ReBake, Role, Shown, State, Traced, Training
from lightwell.fields.surface.edit_state import EditState, edit_key, find_states, kept_rows, setup_json
from lightwell.fields.surface.network_fit import NetworkFit
from lightwell.fields.surface.tracing import validation_samples
from lightwell.networks.checkpoint import restore
from lightwell.networks.light_major import light_runs
from lightwell.scenes.parts import SceneChanges, scene_changes, scene_parts
from lightwell.scenes.variables import from_json, to_json
from lightwell.transport.collect import collect
from lightwell.transport.noticed import noticed
from lightwell.transport.queries import frames
from lightwell.transport.radiance import PathReport
from lightwell.transport.samples import Samples, SurfacePoints, columns_of
from lightwell.transport.seen_shards import without_spikes
from lightwell.transport.stored_columns import stored_columns
from lightwell.transport.surface import draw_surface

ROLES: tuple[Role, ...] = ("indirect", "static")
# Share of the steps of OLD, and of its paths; fewest steps; bounds of the paths of a sample. A lamp that moves in a
# Cornell box: a tenth of the steps 28 s and error 7.5 %, 0.04 of them 13 s and 7.4 %, of a bake of 164 s.
STEPS_SHARE, PATHS_SHARE, FEWEST_STEPS, FEWEST_PATHS, MOST_PATHS = 0.04, 0.1, 100, 8, 64
# Share of the samples that lie on what has changed and around it, at least; how much larger "around" is than it.
FRESH_SHARE, AROUND = 0.04, 0.25
# Points that are drawn everywhere to find those around a change; stream of random numbers.
CANDIDATES, SEED = 1 << 15, 0xED17
# How far the scene may have grown, in extents.
GROWTH = 0.02


@dataclass
class EditedScene(State):
    """The prepared scene of an incremental bake, with the states of the earlier one."""

    before: dict[Role, EditState] = field(default_factory=dict)
    changes: SceneChanges | None = None
    touched: dict[Role, np.ndarray] = field(default_factory=dict)
    """By role, [N] bool: samples that were traced again."""
    errors: dict[Role, tuple[float, float]] = field(default_factory=dict)
    """By role, the error of the old weights and of the new ones on the same held-out samples."""

    @staticmethod
    def of(job: Job, name: str) -> EditedScene:
        """Read the states of an earlier bake and find what has changed since.

        Args:
            job: Scene and settings.
            name: Name of the field.

        Returns:
            The prepared scene.

        Raises:
            ValueError: OLD cannot be started from; one line.
        """
        old: Path = job.options.rebake
        try:
            before = find_states(store_of(old), ROLES)
        except ValueError as error:
            raise ValueError(f"bake: '{old}' holds {error}; bake it again with --keep") from None
        _check(before, job, name)
        facts = next(iter(before.values())).facts
        own = job.request.static and job.scene.has_static_light
        roles = tuple(role for role in before if role == "indirect" or own)
        changes = scene_changes(next(iter(before.values())).parts, scene_parts(job.scene))
        # The next incremental bake may start from this one.
        job.work.keep = True
        return EditedScene(job, job.scene, from_json(facts["variable"]), roles, before=before, changes=changes)

    def finished(self, fits: Mapping[Role, Fit]) -> ReBake:
        """Return the summary of the incremental bake.

        Args:
            fits: The fit of each role.

        Returns:
            The summary.
        """
        assert self.changes is not None
        roles, lines = {}, [f"changed: {', '.join(self.changes.names) or 'nothing'}"]
        for role in fits:
            touched, (old, new) = self.touched[role], self.errors.get(role, (None, None))
            roles[role] = {
                "samples": len(touched),
                "traced_again": int(touched.sum()),
                "error": new,
                "error_before": old,
            }
            error = "" if new is None else f", error {old:.1%} before, {new:.1%} after"
            lines.append(f"{role}: {touched.mean():.1%} of the samples traced again{error}")
        facts = {"from": str(self.job.options.rebake), "changed": list(self.changes.names), "roles": roles}
        first = next(iter(self.before.values())).facts["variable"]
        strength = first["intensity"] * np.asarray(first["color"], np.float64)
        seconds = {"seconds": round(self.job.work.elapsed, 2)}
        return ReBake(Shown(np.asarray(first["initial"], np.float32), strength), facts | seconds, lines, page=True)


def _check(before: Mapping[Role, EditState], job: Job, name: str) -> None:
    """Refuse what the earlier bake does not hold."""
    old = job.options.rebake
    if job.request.lamps:
        raise ValueError("bake: groups of lamps have no incremental bake yet; bake whole, or leave --lamps out")
    if not before:
        raise ValueError(
            f"bake: '{old}' holds nothing of this version of lightwell to start from; "
            f"bake it with --field {name} --keep first"
        )
    first = next(iter(before.values()))
    if first.facts["field"] != name:
        raise ValueError(f"bake: '{old}' holds the field '{first.facts['field']}'; add --field {first.facts['field']}")
    if job.request.static and job.scene.has_static_light and "static" not in before:
        raise ValueError(f"bake: the scene has its own light, and '{old}' had none; bake it whole, or add --no-static")
    low = np.min([part.low for part in first.parts if part.shape], axis=0) - GROWTH * job.scene.extent
    high = np.max([part.high for part in first.parts if part.shape], axis=0) + GROWTH * job.scene.extent
    if (job.scene.bounds[0] < low).any() or (job.scene.bounds[1] > high).any():
        raise ValueError(f"bake: the scene has outgrown that of '{old}'; bake it whole, without --rebake")


# ---------------------------------------------------------------------- samples


def edited_samples(state: EditedScene, role: Role) -> EditState:
    """Trace again the samples that could notice what has changed.

    Args:
        state: The prepared scene.
        role: The role.

    Returns:
        The state with the new samples; the rows of the others keep their bytes.
    """
    before, changes = state.before[role], state.changes
    assert changes is not None
    mesh = changes.mesh[before.points.shape]
    gone = mesh < 0
    query, boxes = before.samples.query, changes.boxes if role == "static" else changes.solid
    touched = gone.copy()
    if len(boxes):
        # Lamps of the scene do not shine where a declared light is learned.
        own = role == "static"
        lamps = changes.lamps if own else changes.lamps[:0]
        variable, light = (None, None) if own else (state.variable, query.light)
        seen = (state.scene, query.position, query.normal, boxes, lamps, before.facts["seed"])
        touched |= noticed(*seen, variable=variable, light=light)
    points = replace_shapes(before.points, np.where(gone, 0, mesh))
    state.touched[role] = touched
    if not touched.any():
        return replace(before, points=points, samples=replace(before.samples, shape=points.shape))
    points = _with_fresh_points(state, role, points, touched, gone)
    return _traced(state, role, before, points, touched)


def replace_shapes(points: SurfacePoints, shape: np.ndarray) -> SurfacePoints:
    """Give points the numbers that their meshes have now.

    Args:
        points: N points.
        shape: [N] numbers of meshes.

    Returns:
        The points.
    """
    return replace(points, shape=np.asarray(shape, np.uint32))


def _with_fresh_points(
    state: EditedScene, role: Role, points: SurfacePoints, touched: np.ndarray, gone: np.ndarray
) -> SurfacePoints:
    """The points with some on what has changed and around it, in the place of those that are gone, and of further
    touched ones."""
    random = np.random.default_rng([state.before[role].facts["seed"], SEED])
    rows = np.flatnonzero(gone)
    more = random.permutation(np.flatnonzero(touched & ~gone))
    rows = np.concatenate([rows, more[: max(int(FRESH_SHARE * len(touched)) - len(rows), 0)]])
    fresh = _fresh_points(state, max(len(rows), 1), int(random.integers(1 << 31)))
    chosen = fresh[np.resize(random.permutation(len(fresh)), len(rows))]
    columns = {name: getattr(points, name).copy() for name in ("shape", "triangle", "barycentric", "view")}
    for name, column in columns.items():
        column[rows] = getattr(chosen, name)
    return SurfacePoints(**columns)


def _fresh_points(state: EditedScene, count: int, seed: int) -> SurfacePoints:
    """Points on the meshes that have changed and on surfaces in and around the boxes of the change."""
    scene, changes = state.scene, state.changes
    assert changes is not None
    drawn = draw_surface(scene, max(CANDIDATES, count), seed, floor=1).points
    place = frames(scene, drawn)[0]
    near = np.zeros(len(drawn), bool)
    for low, high in changes.boxes:
        more = AROUND * float((high - low).max())
        near |= ((place >= low - more) & (place <= high + more)).all(axis=1)
    near |= ~np.isin(drawn.shape, changes.mesh)
    return drawn[np.flatnonzero(near)] if near.any() else drawn


def _traced(state: EditedScene, role: Role, before: EditState, points: SurfacePoints, touched: np.ndarray) -> EditState:
    """Trace the touched rows; every row keeps its light."""
    rows, job = np.flatnonzero(touched), state.job
    paths = int(np.clip(PATHS_SHARE * before.facts["paths"] / len(rows), FEWEST_PATHS, MOST_PATHS)) // 2 * 2
    light, report = before.samples.query.light[rows], PathReport()
    with job.work.timed("trace"), job.progress.stage(f"trace {role}", 1, f"batch of {len(rows):,} samples") as stage:
        made = collect(
            state.scene, state.variable, points[rows], light, paths, before.facts["seed"] + SEED,
            weight=before.samples.weight[rows], own_light=role == "static", report=report,
        )  # fmt: skip
        stage.advance()
    samples = _overwritten(before.samples, rows, made, points.shape)
    if role == "static":
        samples = _limited(before, samples, rows)
    return replace(before, points=points, samples=samples)


def _limited(before: EditState, samples: Samples, rows: np.ndarray) -> Samples:
    """Samples of the scene's own light of which some rows have the limits that those of a full bake have.

    Single paths that found a lamp by way of a glossy surface would be spots of light among the rows that were kept.
    """
    a, b = without_spikes(samples.half_a, samples.half_b, len(samples))
    new = to_learn(replace(samples, half_a=a, half_b=b), "static", before.facts["setup"]["unit"])[rows]
    return _overwritten(samples, rows, new, samples.shape)


def _overwritten(samples: Samples, rows: np.ndarray, made: Samples, shape: np.ndarray) -> Samples:
    """Samples with some rows replaced."""

    def column(old: np.ndarray, new: np.ndarray) -> np.ndarray:
        found = np.array(old)
        found[rows] = new
        return found

    names = ("half_a", "half_b", "weight")
    columns = {name: column(getattr(samples, name), getattr(made, name)) for name in names}
    query = type(samples.query)
    inputs = {n: column(old, getattr(made.query, n)) for n, old in columns_of(samples.query).items()}
    return Samples(query(**inputs), shape=shape, **columns)


# ---------------------------------------------------------------------- fit


def edited_learner(
    state: EditedScene, role: Role, now: EditState, make: Callable[[FieldSetup, int], Learner]
) -> tuple[NetworkFit, Training]:
    """Go on training from the weights of the earlier bake.

    Args:
        state: The prepared scene.
        role: The role.
        now: Result of ``edited_samples``.
        make: Makes an untrained learner of the earlier bake's size from set-up and seed.

    Returns:
        The learner and how it was trained.
    """
    begin, facts, job = perf_counter(), now.facts, state.job
    setup = FieldSetup(**now.setup(), scene=state.scene, variable=state.variable)
    learner = make(setup, facts["seed"])
    assert isinstance(learner, NetworkFit)
    learner.learn_from(now.samples)
    learner.validate_on(validation_samples(state.scene, state.variable, facts["seed"], own_light=role == "static"))
    restore(learner, now.learner)
    if not state.touched[role].any():
        return learner, Training()
    steps = max(int(STEPS_SHARE * facts["steps"]), FEWEST_STEPS)
    # As in the second half of a schedule of twice the steps.
    old = learner.begin_again(steps)
    with job.work.timed("train"), job.progress.stage(f"train {role}", steps, "steps") as stage:
        learner.train(2 * steps, 2 * steps, lambda s, _: stage.move_to(s.step - steps, f"error {s.best_error:.1%}"))
    state.errors[role] = (old, learner.state.best_error)
    return learner, Training(perf_counter() - begin, steps)


def keep_edited(state: EditedScene, role: Role, now: EditState, learner: Learner, store: Store, shown: Shown) -> None:
    """Store what the next incremental bake starts from.

    Args:
        state: The prepared scene.
        role: The role.
        now: The state with the new samples.
        learner: The trained learner.
        store: Where to keep it.
        shown: The light under which the bake is shown first.
    """
    del shown  # that of the earlier bake
    kept = replace(now, learner=learner.arrays(), parts=scene_parts(state.scene))
    store.put(edit_key(role), kept.arrays(), ARRAYS)


def traced_facts(now: EditState, touched: np.ndarray) -> Traced:
    """Summarise what was traced.

    Args:
        now: The state with the new samples.
        touched: [N] samples that were traced again.

    Returns:
        The summary.
    """
    return Traced(samples=len(now.samples), paths=int(touched.sum()) * FEWEST_PATHS)


@dataclass(frozen=True)
class FirstState:
    """Stores what an incremental bake starts from, after a full bake of one role."""

    state: State
    role: Role
    name: str
    """Name of the field."""
    samples: Samples
    """Those of the shards, in their order."""
    learner: NetworkFit
    shards: int
    paths: int
    """Light paths that were traced."""

    def __call__(self, store: Store, shown: Shown) -> None:
        """Store it.

        Args:
            store: Where to keep it.
            shown: The light under which the bake is shown first.
        """
        job, samples = self.state.job, self.samples
        rows = kept_rows(len(samples), light_runs(samples.query.light))
        folder = job.work.samples(f"{self.role}-uniform")
        triangle, barycentric = stored_columns(folder, self.shards, ("triangle", "barycentric"))
        kept = samples[rows]
        points = SurfacePoints(kept.shape, triangle[rows], barycentric[rows], kept.query.view)
        strength = max(float(shown.intensity.max()), 1e-30)
        facts: dict[str, Any] = {
            "field": self.name,
            "preset": job.request.preset,
            "seed": job.request.seed,
            "steps": self.learner.state.step,
            "paths": self.paths,
            "setup": setup_json(self.learner.setup),
            "variable": to_json(self.state.variable, shown.light, strength, shown.intensity / strength),
        }
        made = EditState(kept, points, self.learner.arrays(), scene_parts(self.state.scene), facts)
        store.put(edit_key(self.role), made.arrays(), ARRAYS)
