"""The light of the probes beside a field, by role: what it follows, how it is traced and solved, and its graph.

========  =========================================  ==========================================
role      the probes follow                          one basis per
========  =========================================  ==========================================
indirect  a declared light that moves                leading singular vector of its states
static    the dimmers of groups of lamps             group
static    a node that moves                          pose that is traced
static    both                                       group and pose, or singular vector of them
static    nothing                                    –
========  =========================================  ==========================================
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from lightwell.fields.base import FieldSetup, around_samples
from lightwell.fields.field_and_probes.plan import ProbePlan, probe_plan
from lightwell.fields.probes.baked import mixed, singular_mix
from lightwell.fields.probes.fit import PRESETS, ProbesFit, ProbesPreset, Solved, fit_of, solved, weights_of
from lightwell.fields.protocol import Role, State
from lightwell.fields.surface.posed_lamp_samples import lamps_in
from lightwell.graph import Graph
from lightwell.probes.baselines import compare
from lightwell.probes.code import LampMix, Mixing, PosedLampMix, PoseMix
from lightwell.probes.light import SolvedVolume, light_volume, refined
from lightwell.probes.lower import lower
from lightwell.probes.states import OwnStates
from lightwell.probes.volume import ProbeVolume
from lightwell.scenes.posing import posed
from lightwell.scenes.scene_cache import Derived
from lightwell.transport.samples import Samples

# Preset of the probes of each quality.
QUALITY_PRESETS = {"draft": "draft", "good": "default", "best": "fine"}
# Poses that are traced, by quality; both end stops are among them.
POSES = {"draft": 3, "good": 5, "best": 9}
# Groups of lamps that probes can tell apart, and bases of lamps in several poses: a pixel holds 27 numbers of each.
MOST_GROUPS, MOST_BASES = 16, 16
# Samples that the network of a moving light learns from, and its steps by quality.
CODE_SAMPLES, CODE_STEPS = 1 << 15, {"draft": 150, "good": 600, "best": 2000}

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

    def lower(self) -> Graph:
        """Return the shading graph; what moves is looked up without an offset along its normal.

        Returns:
            The graph.
        """
        return lower(self.volume.in_air(), self.unit, self.basis / self.unit, self.mixing)

    @property
    def follows(self) -> str:
        """What the light of the probes follows, in words."""
        if self.mixing is None:
            return "nothing: the light of the scene as it is"
        lamps, node = "the switches of the lamps", "the node that moves"
        names = {LampMix: lamps, PoseMix: node, PosedLampMix: f"{lamps} and {node}"}
        return names.get(type(self.mixing), "the light that moves")

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
            "follows": self.follows,
        }


def check_probes(state: State) -> None:
    """Refuse what probes cannot follow, before anything is traced.

    Args:
        state: The prepared scene.

    Raises:
        ValueError: Several things vary, or there are too many groups of lamps.
    """
    names = [mover.name for mover in state.scene.movers]
    if "indirect" in state.roles and state.variable is not None:
        names += [light.name for light in (state.variable, *state.more)]
    if len(names) > 1:
        raise ValueError(
            f"bake: probes follow one light, node or clip, not {len(names)} ({', '.join(names)}); drop others from "
            "--vary, or use --field factored"
        )
    if len(state.lamps) > MOST_GROUPS:
        raise ValueError(
            f"bake: probes tell at most {MOST_GROUPS} groups of lamps apart, found {len(state.lamps)}; join some with "
            "--lamps NAME=PATTERN, or use --field factored"
        )


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
                _ = self._moving if role == "indirect" else self._own
                stage.advance()

    def fitted(self, role: Role, unit: float, samples: Samples | None) -> RoleProbes:
        """Return the probes of a role; the network of a moving light is trained.

        Args:
            role: The role.
            unit: Radiance unit S.
            samples: Training samples of the moving light; not used for the scene's own.

        Returns:
            The probes.
        """
        if role == "static":
            return self._own_probes(unit)
        assert samples is not None
        state, request = self._state, self._state.job.request
        order = np.random.default_rng((request.seed, len(samples))).permutation(len(samples))
        part = samples[np.sort(order[:CODE_SAMPLES])]
        setup = around_samples(replace(self._setup("indirect"), unit=unit), samples)
        fit = ProbesFit(setup, self._moving_preset, request.seed, self._moving, name=self._name)
        fit.learn_from(part)
        fit.validate_on(part[:: max(len(part) // 4096, 1)])
        steps = min(CODE_STEPS[request.quality], request.steps or CODE_STEPS[request.quality])
        with state.job.work.timed("probes"):
            fit.train(steps, steps)
        made = fit.baked
        volume = made.lit.geometry.volume
        return RoleProbes(volume, made.basis, made.code, unit, self._preset.coding, self._moving[2])

    # ------------------------------------------------------------------ plan

    @cached_property
    def plan(self) -> ProbePlan:
        """The plan, measured once."""
        state = self._state
        setup = FieldSetup.of(state.scene, 1.0, "static")
        spacing = state.job.options.spacing or 2 * setup.half_extent / self._preset.along
        wanted: dict[str, int] = {}
        for role in state.roles:
            wanted[role] = self._preset.states if role == "indirect" else self._own_count
        geometry = partial(weights_of, setup, self._preset)
        return probe_plan(state.job, state.scene, self._preset, spacing, wanted, geometry)

    @property
    def _own_count(self) -> int:
        """States of the scene's own light."""
        state = self._state
        return (len(self._poses) if state.scene.movers else 1) * max(len(state.lamps), 1)

    # ------------------------------------------------------------------ a light that moves

    def _setup(self, role: Role) -> FieldSetup:
        state = self._state
        if role == "static" or state.variable is None:
            return FieldSetup.of(state.scene, 1.0, "static")
        return FieldSetup.of(state.scene, 1.0, state.variable.kind, state.variable)

    @property
    def _moving_preset(self) -> ProbesPreset:
        plan, preset = self.plan, self._preset
        sampling, bricks = plan.sampling(preset.sampling), preset.bricks if plan.bricks else 0.0
        return replace(preset, sampling=sampling, bricks=bricks, states=plan.states["indirect"])

    @property
    def _moving(self) -> Solved:
        """Light of all states of the declared light, factors of the bases, and errors in the air."""
        seed = self._state.job.request.seed
        return solved(self._setup("indirect"), self._moving_preset, seed, self.plan.spacing)

    # ------------------------------------------------------------------ the scene's own light

    @property
    def _states(self) -> OwnStates | None:
        """States of the scene's own light; None: as it is."""
        state = self._state
        if not (state.scene.movers or state.lamps):
            return None
        scenes, shining = [], []
        for at in (posed(state.scene, (at,)) for at in self._poses) if state.scene.movers else (state.scene,):
            groups = lamps_in(at, state.job.request.lamps, state.lamps) if state.lamps else ()
            shining += [group.emitters for group in groups] or [()]
            scenes += [at] * max(len(groups), 1)
        return OwnStates(tuple(scenes), tuple(shining))

    @property
    def _poses(self) -> tuple[float, ...]:
        return tuple(np.linspace(0, 1, POSES[self._state.job.request.quality]).tolist())

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
        bases = np.moveaxis(light, 0, -1) if light.ndim == 4 else light[..., None]
        mixing: Mixing | None = None
        # The score is that of the file's first pose, with all lamps.
        scene = posed(state.scene, (0.0,)) if state.scene.movers else state.scene
        first = max(len(state.lamps), 1)
        if state.scene.movers and state.lamps:
            bases, mix = reduced(light, np.flatnonzero(lit.geometry.volume.alive), MOST_BASES)
            mixing = PosedLampMix(self._poses, mix.reshape(len(self._poses), first, -1))
        elif state.scene.movers:
            mixing = PoseMix(self._poses)
        elif state.lamps:
            mixing = LampMix(len(state.lamps))
        if mixing is not None:
            light, start = light[:first].sum(axis=0), start[:first].sum(axis=0)
        score = compare(scene, lit.geometry, light, start, state.job.request.seed)
        return RoleProbes(lit.geometry.volume, bases, mixing, unit, self._preset.coding, score)


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
    bases = mixed(states, singular_mix(states, live, most))
    rows = bases[live].reshape(-1, bases.shape[-1]).astype(np.float64)
    wanted = states[:, live].reshape(len(states), -1).astype(np.float64)
    return bases, np.linalg.lstsq(rows, wanted.T, rcond=None)[0].T
