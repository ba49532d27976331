"""Learned representations, one file each: fit to samples, lower to a shading graph."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

from lightwell.fields import balanced, experts, factored, hard_mixture, kdtree, mlp, probes, tree
from lightwell.fields.base import FieldSetup as FieldSetup
from lightwell.fields.base import Fit as Fit
from lightwell.fields.base import query_inputs as query_inputs
from lightwell.fields.base import radiance_unit as radiance_unit

# Every representation is a module with PRESETS and start(setup, preset, seed); the first is the default.
FIELDS: dict[str, ModuleType] = {
    "factored": factored,
    "mlp": mlp,
    "tree": tree,
    "kdtree": kdtree,
    "experts": experts,
    "hard-mixture": hard_mixture,
    "balanced": balanced,
    "probes": probes,
}


def presets(field: str) -> list[str]:
    """Names of a field's presets, the default first."""
    return list(FIELDS[field].PRESETS)


def field_of(preset: str) -> str:
    """The field that a preset alone means: the first that has it, the default one where none has."""
    return next((name for name in FIELDS if preset in presets(name)), next(iter(FIELDS)))


def starter(field: str, preset: str) -> Callable[[FieldSetup, int], Fit]:
    """The function (setup, seed) → Fit of a named field and preset; ValueError for an unknown name."""
    if field not in FIELDS:
        raise ValueError(
            f"bake: unknown field '{field}'; choose one of {', '.join([*FIELDS, 'lightmap'])} with --field"
        )
    if preset not in FIELDS[field].PRESETS:
        raise ValueError(
            f"bake: field '{field}' has no preset '{preset}'; choose one of {', '.join(presets(field))} with --preset"
        )
    return lambda setup, seed: FIELDS[field].start(setup, preset, seed)
