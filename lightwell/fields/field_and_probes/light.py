"""The light of the probes beside a field, by role: what it follows, how it is traced and solved, and its graph.

One mechanism serves all variables: light is traced and solved in some states of all of them together, the states are
expressed by at most 16 bases, and what the bases are multiplied by is computed once a frame.

========  ===============================  ==============================================  ==================
role      states                           bases                                           factors
========  ===============================  ==============================================  ==================
indirect  places of the light, each in a   bases of least relative error                   spline in the
          pose of what moves                                                               place and the pose
static    every group of lamps in every    states, or bases of least relative error        dimmers times hat
          pose of a grid                   where there are more than 16                    functions of poses
========  ===============================  ==============================================  ==================

A moving point, a sun, a day with its sky and an environment map that turns are all lights of a role of their own; light
adds up. Notation: S states, K bases, M movers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.probes.baked import storable
from lightwell.fields.probes.fit import PRESETS, ProbesPreset, Solved, fit_of, pose_rows, solved, spline_of, weights_of
from lightwell.fields.probes.plan import ProbePlan, probe_plan
from lightwell.fields.protocol import Role, State
from lightwell.fields.surface.posed_lamp_samples import lamps_in
from lightwell.graph import Graph
from lightwell.graph.budget import BUDGET
from lightwell.graph.pose_basis import PoseBasis
from lightwell.probes.baselines import compare
from lightwell.probes.code import Mixing, StateMix
from lightwell.probes.end_stops import dark_at_stops
from lightwell.probes.lattice import default_spacing
from lightwell.probes.light import SolvedVolume, light_volume, refined
from lightwell.probes.low_rank import LowRank
from lightwell.probes.lower import lower
from lightwell.probes.states import JointStates
from lightwell.probes.volume import ProbeVolume
from lightwell.scenes.posing import posed
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.variables import PointLight

# Preset of the probes of each quality.
QUALITY_PRESETS = {"draft": "draft", "good": "default", "best": "fine"}
# Nodes of each slider where one, two and three things move, by quality; both end stops are among them.
POSES = {"draft": (3, 2, 2), "good": (5, 3, 2), "best": (9, 4, 3)}
# Most bases: a pixel holds 27 numbers of each. A light beside a mover takes so many times those of the light alone.
MOST_BASES, BASES_BESIDE = 16, 2
# Work of a pixel for each base without bricks and with them, at most: probes of all roles together have the budget of a
# file (format/FORMAT.md, *Budget*).
WORK_OF_BASE, WORK_BESIDE_BRICKS = 1400, 2800
# States of such a light, times those of the light alone.
STATES_BESIDE = 2
OWN_LIGHT = Derived[SolvedVolume]("field_and_probes.own_light")


@dataclass(frozen=True)
class RoleProbes:
    """The probes of one role. P nodes, F fine probes, K bases."""

    volume: ProbeVolume
    """Weights, without light."""
    basis: np.ndarray
    """[P + F, 9, 3, K] float32."""
    mixing: Mixing | None
    """What the bases are mixed by; None: one basis that stays."""
    unit: float
    """Radiance unit S of the graph."""
    coding: str
    """Number format of the light in files of probes."""
    score: dict[str, Any]
    """Errors in the air, of these weights and of trilinear ones; see ``probes.baselines.compare``."""
    lost: float = 0.0
    """Relative error of the state that the bases express worst; 0: they are the states."""

    def lower(self) -> Graph:
        """Return the shading graph; what moves is looked up without an offset along its normal.

        Returns:
            The graph.
        """
        return lower(self.volume.in_air(), self.unit, storable(self.basis / self.unit), self.mixing)

    @property
    def follows(self) -> str:
        """What the light of the probes follows, in words."""
        if self.mixing is None:
            return "nothing: the light of the scene as it is"
        movers = self.mixing.inputs.get("pose", 0)
        moving = "the node that moves" if movers == 1 else f"the {movers} things that move"
        light = "the switches of the lamps" if "lamps" in self.mixing.inputs else "the light that moves"
        found = [light] if self.mixing.inputs.keys() & {"lamps", "light"} else []
        return " and ".join(found + ([moving] if movers else []))

    @property
    def facts(self) -> dict[str, Any]:
        """JSON values for the report."""
        learned, trilinear = (self.score.get(name, {}).get("smape") for name in ("learned", "trilinear"))
        return {
            "error_in_the_air": learned,
            "error_of_trilinear_weights": trilinear,
            "count": int(self.volume.alive.sum()),
            "spacing": self.volume.lattice.spacing,
            "bases": self.basis.shape[-1],
            "error_of_bases": self.lost,
            "follows": self.follows,
        }


def pose_grid(quality: str, movers: int) -> PoseBasis | None:
    """Choose the poses in which the light of probes is traced.

    Args:
        quality: 'draft', 'good' or 'best'.
        movers: M.

    Returns:
        Their grid; None: nothing moves.
    """
    return PoseBasis((tuple(np.linspace(0, 1, POSES[quality][movers - 1]).tolist()),) * movers) if movers else None


def preset_of(quality: str) -> tuple[str, ProbesPreset]:
    """Choose the settings of the probes of a quality.

    Args:
        quality: 'draft', 'good' or 'best'.

    Returns:
        Name and settings.
    """
    name = QUALITY_PRESETS[quality]
    return name, PRESETS[name]


class ProbeLight:
    """Plans and solves the probes of a bake; what is solved is kept with the scene."""

    def __init__(self, state: State) -> None:
        """Take a prepared scene.

        Args:
            state: The prepared scene.
        """
        self._state, request = state, state.job.request
        self._name, self._preset = preset_of(request.quality)

    def solve(self) -> None:
        """Trace and solve the light of all roles, in the probes' share of the time."""
        job = self._state.job
        with job.work.timed("probes"), job.progress.stage("probes", len(self._state.roles), "fields") as stage:
            plan = self.plan
            states = ", ".join(f"{count} of {role}" for role, count in plan.states.items())
            stage.advance(0, f"{plan.spacing:.2g} m apart, states: {states}")
            for role in self._state.roles:
                _ = self._own if role == "static" else self._moving(role)
                stage.advance()

    def fitted(self, role: Role, unit: float) -> RoleProbes:
        """Return the probes of a role.

        Args:
            role: The role.
            unit: Radiance unit S.

        Returns:
            The probes.
        """
        return self._own_probes(unit) if role == "static" else self._moving_probes(role, unit)

    # ------------------------------------------------------------------ plan

    @cached_property
    def plan(self) -> ProbePlan:
        """The plan, measured once."""
        state = self._state
        setup = FieldSetup.of(state.scene, 1.0, "static")
        spacing = state.job.options.spacing or default_spacing(state.scene.core, self._preset.along)
        times = STATES_BESIDE if state.scene.movers else 1
        variables = {role: None if role == "static" else state.for_role(role).variable for role in state.roles}
        wanted = {
            role: self._own_count if v is None else times * self._preset.states_of(v) for role, v in variables.items()
        }
        geometry = partial(weights_of, setup, self._preset)
        return probe_plan(state.job, state.scene, self._preset, spacing, variables, wanted, geometry)

    @property
    def _own_count(self) -> int:
        """States of the scene's own light."""
        state = self._state
        return (self._poses.count if self._poses else 1) * max(len(state.lamps), 1)

    @cached_property
    def _poses(self) -> PoseBasis | None:
        """Poses that are traced; None: nothing moves."""
        return pose_grid(self._state.job.request.quality, len(self._state.scene.movers))

    # ------------------------------------------------------------------ a light that moves

    def _setup(self, role: Role) -> FieldSetup:
        state = self._state.for_role(role)
        if role == "static" or state.variable is None:
            return FieldSetup.of(state.scene, 1.0, "static")
        return FieldSetup.of(state.scene, 1.0, state.variable.kind, state.variable)

    def _moving_preset(self, role: Role) -> ProbesPreset:
        preset, planned = self._preset, self.plan.applied(self._preset, role)
        rank = min(preset.rank * BASES_BESIDE, MOST_BASES) if self._poses else preset.rank
        bricks = planned.bricks > 0 and not isinstance(self._setup(role).variable, PointLight)
        return replace(planned, rank=min(rank, self._affordable(bricks)))

    def _affordable(self, bricks: bool) -> int:
        """Bases that a pixel has the work for where all roles have as many; own light of one state has one."""
        roles = sum(role != "static" or self._own_count > 1 for role in self._state.roles)
        return most_bases(max(roles, 1), bricks)

    def _moving(self, role: Role) -> Solved:
        """Light of all states of a declared light, factors of the bases, and errors in the air."""
        seed = self._state.job.request.seed
        return solved(self._setup(role), self._moving_preset(role), seed, self.plan.spacing, self._poses)

    def _moving_probes(self, role: Role, unit: float) -> RoleProbes:
        lit, low, score = self._moving(role)
        assert low is not None
        poses, seed, live = self._poses, self._state.job.request.seed, np.flatnonzero(lit.geometry.volume.alive)
        bases, factors = low.bases(lit.solution.light), low.factors
        rows = None if poses is None else pose_rows(len(factors), poses, seed)
        mixing = spline_of(self._setup(role), lit, low, rows)
        if poses is not None and rows is not None:
            lights = lit.lights.lights if isinstance(lit.lights, JointStates) else lit.lights
            assert lights is not None
            states = lit.solution.light[:, live]
            mixing = dark_at_stops(mixing, lights, rows, states, bases[live], poses.nodes)
        lost = error_of_bases(lit.solution.light[:, live], bases[live], factors)
        return RoleProbes(lit.geometry.volume, bases, mixing, unit, self._preset.coding, score, lost)

    # ------------------------------------------------------------------ the scene's own light

    @property
    def _states(self) -> JointStates | None:
        """States of the scene's own light, the groups fastest; None: as it is."""
        state, poses = self._state, self._poses
        if not (poses or state.lamps):
            return None
        scenes, shining = [], []
        for at in [posed(state.scene, pose) for pose in poses.poses] if poses else [state.scene]:
            groups = lamps_in(at, state.job.request.lamps, state.lamps) if state.lamps else ()
            shining += [group.emitters for group in groups] or [()]
            scenes += [at] * max(len(groups), 1)
        return JointStates(tuple(scenes), tuple(shining))

    @property
    def _own(self) -> SolvedVolume:
        """Light of all states of the scene's own light."""
        state, plan, preset = self._state, self.plan, self._preset
        names = [group.name for group in state.lamps]
        arguments = (self._name, str(plan), str(names), state.job.request.seed)

        def make() -> SolvedVolume:
            geometry = weights_of(self._setup("static"), preset, plan.spacing)
            sampling, states = plan.sampling(preset.static_sampling), self._states
            lit = light_volume(state.scene, geometry, sampling, state.job.request.seed, None, states)
            return refined(state.scene, lit, preset.bricks, fit_of(preset)) if plan.bricks else lit

        return state.scene.cache.get(OWN_LIGHT, make, arguments)

    def _own_probes(self, unit: float) -> RoleProbes:
        lit, state = self._own, self._state
        light, start = lit.solution.light, lit.start
        # The score is that of the first pose, with all lamps.
        scene = posed(state.scene, self._poses.poses[0]) if self._poses else state.scene
        bases, mixing, lost = light[..., None], None, 0.0
        if light.ndim == 4:
            groups, live = max(len(state.lamps), 1), np.flatnonzero(lit.geometry.volume.alive)
            most = min(MOST_BASES, self._affordable(lit.geometry.volume.bricks is not None))
            bases, mix = reduced(light, live, most)
            lost = error_of_bases(light[:, live], bases[live], mix)
            mixing = StateMix(mix.reshape(-1, groups, mix.shape[1]), self._poses, bool(state.lamps))
            light, start = light[:groups].sum(axis=0), start[:groups].sum(axis=0)
        score = compare(scene, lit.geometry, light, start, state.job.request.seed)
        return RoleProbes(lit.geometry.volume, bases, mixing, unit, self._preset.coding, score, lost)


def most_bases(roles: int, bricks: bool) -> int:
    """Compute how many bases the probes of each role may have, so that a page can evaluate all of them.

    Args:
        roles: Roles whose light is mixed of bases, ≥ 1.
        bricks: Whether cells have bricks.

    Returns:
        Most bases of each.
    """
    return int(BUDGET.work / (roles * (WORK_BESIDE_BRICKS if bricks else WORK_OF_BASE)))


def reduced(states: np.ndarray, live: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Express the light of states by at most so many bases; exactly where there are no more states.

    Args:
        states: [S, P, 9, 3] light of the states.
        live: [L] indices of the probes that count.
        most: Most bases K.

    Returns:
        [P, 9, 3, K] bases, and [S, K] factors with which they give the states.
    """
    if len(states) <= most:
        return np.moveaxis(states, 0, -1), np.eye(len(states))
    low = LowRank.of(states, live, most)
    return low.bases(states), low.factors


def error_of_bases(states: np.ndarray, bases: np.ndarray, mix: np.ndarray) -> float:
    """Compute how much of the light of states is lost where fewer bases express them.

    Args:
        states: [S, P, 9, 3] light of the states.
        bases: [P, 9, 3, K] bases.
        mix: [S, K] factors with which they give the states.

    Returns:
        Root mean square of what is missing, relative to the state, of the worst state.
    """
    errors = [0.0]
    for state, factors in zip(states, mix):
        size = np.linalg.norm(state)
        errors += [float(np.linalg.norm(state - bases @ factors) / size)] if size > 0 else []
    return max(errors)
