"""The incremental bake of light probes: ``lightwell bake SCENE --field probes --rebake OLD --box x0,y0,z0,x1,y1,z1``.

Only the probes that the box affects are fitted, traced and solved again, with the settings of OLD, which was baked with
``--keep``. Nothing is trained, and nothing is measured against the reference: a full bake does that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.asset.container import read_file
from lightwell.asset.records import EXTENSION
from lightwell.core.formats import COMPRESSED
from lightwell.core.options import flag_of, options_of
from lightwell.core.store import Store
from lightwell.core.vary import parse_vary
from lightwell.core.work import store_of
from lightwell.fields.probes.baked import BakedProbes, state_key
from lightwell.fields.probes.fit import PRESETS, fit_of, payload
from lightwell.fields.protocol import ExtraFile, Fit, Job, ReBake, Role, Shown, State, Traced, Training
from lightwell.fields.request import Request
from lightwell.fields.surface.field import SurfaceFit
from lightwell.graph import Graph
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, declare, from_json

ROLES: tuple[Role, ...] = ("indirect", "static")
# What parameters of ``--vary`` decide of a lamp, and all others of a sun.
OF_LAMP = {"position": ("low", "high"), "radius": ("radius",), "clearance": ("clearance",)}
OF_SUN = ("start", "middle", "end")


@dataclass
class RebakeState(State):
    """The prepared scene of an incremental bake, with the probes of the earlier bake."""

    before: dict[Role, tuple[BakedProbes, Shown]] = field(default_factory=dict)

    @staticmethod
    def of(job: Job) -> RebakeState:
        """Read the probes of an earlier bake.

        A folder without probes, or with those of another scene or of another light, is a ``ValueError``.

        Args:
            job: Scene and settings.

        Returns:
            The prepared scene.
        """
        old, scene = job.options.rebake, job.scene
        _check_request(job.request)
        kept = _kept(old)
        # The next incremental bake may start from this one.
        job.work.keep = True
        _check(scene, kept, old)
        return RebakeState(job, scene, _light(old, job), tuple(kept), before=kept)

    def finished(self, fits: Mapping[Role, Fit]) -> ReBake:
        """Return the summary of the incremental bake.

        Args:
            fits: The fit of each role.

        Returns:
            The summary.
        """
        options, roles, lines = self.job.options, {}, []
        for role, fit in fits.items():
            roles[role] = fit.facts
            lines.append(
                f"{role}: {fit.facts['solved_again']} of {fit.facts['probes']} probes solved again "
                f"in {fit.facts['seconds']:.2f} s"
            )
        facts = {"from": str(options.rebake), "box": np.reshape(options.box, (2, 3)).tolist(), "roles": roles}
        return ReBake(next(iter(self.before.values()))[1], facts, lines)


@dataclass
class RebakedProbes:
    """The probes after a change of the scene, in the place of a learner."""

    scene: Scene
    role: Role
    probes: BakedProbes
    shown: Shown
    facts: dict[str, Any]
    note: str = ""

    def lower(self) -> Graph:
        """Return the shading graph.

        Returns:
            The graph.
        """
        return self.probes.lower()

    def files(self, glb: Path, shown: Shown, store: Store | None = None) -> list[ExtraFile]:
        """List the files beside the asset, and store what the next incremental bake starts from.

        Args:
            glb: Path of the asset.
            shown: Not used: the light is that of the earlier bake.
            store: Where to keep what the next incremental bake starts from; None: it is not kept.

        Returns:
            The files.
        """
        files, in_file = self.probes.files(self.role, glb, self.scene, self.shown, store)
        self.note = payload(self.probes.lit.geometry.volume, self.probes.coding, in_file)
        return files


def rebaked(state: RebakeState, role: Role) -> SurfaceFit:
    """Solve again the probes that the changed box affects.

    Args:
        state: The prepared scene.
        role: Role of the probes.

    Returns:
        The fit.
    """
    before, shown = state.before[role]
    start, box = perf_counter(), np.reshape(state.job.options.box, (2, 3))
    after, again = before.rebaked(state.scene, state.variable, box, fit_of(PRESETS[before.preset]))
    facts = {
        "probes": int(after.lit.geometry.volume.alive.sum()),
        "solved_again": len(again),
        "seconds": round(perf_counter() - start, 3),
    }
    probes = RebakedProbes(state.scene, role, after, shown, facts)
    return SurfaceFit(state.scene, probes, after.unit, Traced(), {}, Training())


def _kept(old: Path) -> dict[Role, tuple[BakedProbes, Shown]]:
    """The probes of each role that the store of an earlier bake holds."""
    stored = {role: store_of(old).find(state_key(role), COMPRESSED) for role in ROLES}
    try:
        kept = {role: BakedProbes.of(arrays) for role, arrays in stored.items() if arrays is not None}
    except ValueError as error:
        raise ValueError(f"bake: '{old}' holds {error}; bake it again with --field probes --keep") from error
    if not kept:
        raise ValueError(
            f"bake: '{old}' holds no probes of this version of lightwell to start from; "
            "bake it with --field probes --keep first"
        )
    return kept


def _check(scene: Scene, kept: dict[Role, tuple[BakedProbes, Shown]], old: Path) -> None:
    """The presets must be known, and the lattice must still hold the scene."""
    for before, _ in kept.values():
        if before.preset not in PRESETS:
            raise ValueError(f"bake: '{old}' has the unknown preset '{before.preset}'; bake the scene whole")
    lattice = next(iter(kept.values()))[0].lit.geometry.volume.lattice
    low, high = lattice.origin, lattice.origin + lattice.spacing * np.array(lattice.cells)
    if (scene.core[0] < low - 1e-4).any() or (scene.core[1] > high + 1e-4).any():
        raise ValueError(f"bake: the scene has outgrown the probes of '{old}'; bake it whole, without --rebake")


def _light(old: Path, job: Job) -> Variable | None:
    """The light of the earlier bake, whose places the probes hold; another one that is declared is refused."""
    said = [d for d in map(parse_vary, job.request.vary) if d.learned and not d.moves]
    asked = declare(job.request.vary, job.scene)
    if not (old / "scene.glb").is_file():
        return asked
    document, _ = read_file(old / "scene.glb")
    entries = document.get("extensions", {}).get(EXTENSION, {}).get("variables", [])
    known = from_json(entries[0]) if entries else None
    names = [name for d in said for name in OF_LAMP.get(d.parameter, OF_SUN)]
    if said and (known is None or not _same(asked, known, names)):
        raise ValueError(f"bake: '{old}' was baked with another light; repeat its --vary, or leave --vary out")
    return known


def _same(asked: Variable, known: Variable, names: Sequence[str]) -> bool:
    """Whether two lights are of one kind, with the same ranges of these names."""
    alike = lambda name: np.allclose(getattr(asked, name), getattr(known, name), rtol=1e-5, atol=1e-6)  # noqa: E731
    return asked.kind == known.kind and all(map(alike, names))


def _check_request(request: Request) -> None:
    """Refuse options that an incremental bake takes from the earlier one, and those without effect."""
    default = Request()
    for name, (_, known) in options_of(Request).items():
        if name != "vary" and getattr(request, name) != getattr(default, name):
            raise ValueError(
                f"bake: {flag_of(name, known)} has no meaning with --rebake, which repeats the bake in OLD; omit it"
            )
