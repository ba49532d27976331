"""Fields by name: those of lightwell, and those that other distributions add as entry points ``lightwell.fields``.

A distribution adds a field by naming an object that follows ``lightwell.fields.protocol.Field``:

    [project.entry-points."lightwell.fields"]
    mean = "my_package.mean:FIELD"
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any

from lightwell.core.suggest import did_you_mean

if TYPE_CHECKING:
    from lightwell.fields.protocol import Field

GROUP = "lightwell.fields"

# Name → module that holds the field as ``FIELD``. The first is the default.
BUILT_IN = {
    "factored": "lightwell.fields.surface.factored",
    "mlp": "lightwell.fields.surface.mlp",
    "tree": "lightwell.fields.surface.tree",
    "kdtree": "lightwell.fields.surface.kdtree",
    "experts": "lightwell.fields.surface.experts",
    "hard-mixture": "lightwell.fields.surface.hard_mixture",
    "balanced": "lightwell.fields.surface.balanced",
    "transfer": "lightwell.fields.surface.transfer",
    "probes": "lightwell.fields.probes.field",
    "volume": "lightwell.fields.volume.field",
    "lightmap": "lightwell.fields.lightmap.field",
    "factored+probes": "lightwell.fields.field_and_probes.field",
}
DEFAULT = next(iter(BUILT_IN))
# Fields of lightwell with options of their own, in modules that import nothing heavy: help must be instant.
OPTIONS = {
    "factored": ("lightwell.fields.surface.options", "SurfaceOptions"),
    "mlp": ("lightwell.fields.surface.options", "SurfaceOptions"),
    "probes": ("lightwell.fields.probes.options", "ProbesOptions"),
    "volume": ("lightwell.fields.volume.options", "VolumeOptions"),
    "lightmap": ("lightwell.fields.lightmap.options", "LightmapOptions"),
    "factored+probes": ("lightwell.fields.field_and_probes.options", "FieldAndProbesOptions"),
}
# Presets of each field, so that help and mistakes need none of the modules above; a test compares them.
PRESETS: dict[str, tuple[str, ...]] = {
    "factored": ("default", "small", "large", "draft", "best"),
    "mlp": ("default", "small", "large", "report-20", "report-200", "report", "report-code"),
    "tree": ("default", "report"),
    "kdtree": ("default", "report", "ren"),
    "experts": ("default", "report", "report-joint", "report-multinomial", "report-code", "report-border-boost"),
    "hard-mixture": ("default", "report"),
    "balanced": ("default", "large"),
    "transfer": ("default", "pca", "small"),
    "probes": (
        "default",
        "draft",
        "l2",
        "relu-field",
        "relu-field-5",
        "product-field",
        "mlp",
        "mlp-generated",
        "mlp-direct",
        "bare-relu-field-5",
        "bare-product-field",
        "bare-mlp",
        "fine",
    ),
    "volume": ("default", "draft", "fine"),
    "lightmap": (
        "default",
        "report",
        "report-relu",
        "siren",
        "siren-two-stage",
        "default-int8",
        "plain",
        "directional",
        "draft",
        "best",
    ),
    "factored+probes": ("default", "small", "large", "draft", "best"),
}
# Preset of each quality where it is not the default one; fields without an entry differ in time alone.
QUALITY_PRESETS = {
    "factored": {"draft": "draft", "best": "best"},
    "mlp": {"draft": "small", "best": "large"},
    "balanced": {"best": "large"},
    "probes": {"draft": "draft", "best": "fine"},
    "volume": {"draft": "draft", "best": "fine"},
    "lightmap": {"draft": "draft", "best": "best"},
    "factored+probes": {"draft": "draft", "best": "best"},
}
# The one field that is two in one file.
COMBINED = "factored+probes"


def field_names() -> tuple[str, ...]:
    """List the names of all fields, those of other distributions last.

    Returns:
        Names, each once; the default field comes first.
    """
    return (*BUILT_IN, *(name for name in _added() if name not in BUILT_IN))


def find_field(name: str) -> Field:
    """Return a field by its name; the module or distribution that holds it is imported.

    Args:
        name: Name of a field, as ``field_names`` lists it.

    Returns:
        The field.

    Raises:
        ValueError: The name is unknown. A distribution that cannot be loaded is one as well.
    """
    if name in BUILT_IN:
        return import_module(BUILT_IN[name]).FIELD
    if name not in _added():
        raise ValueError(str(unknown_field(name)))
    return _loaded(name)


def unknown_field(name: str) -> ValueError:
    """Make the error for a field that does not exist.

    Args:
        name: The name that was given.

    Returns:
        The error, with the nearest name or all of them.
    """
    if "+" in name and name != COMBINED:
        return ValueError(
            f"fields cannot be joined as '{name}'; the one pair is --field {COMBINED}, else bake each by itself"
        )
    cure = did_you_mean(name, field_names(), f"choose one of {', '.join(field_names())} with --field")
    return ValueError(f"unknown field '{name}'; {cure}")


def options_type(name: str) -> type:
    """Return the dataclass of a field's own options.

    Args:
        name: Name of a field.

    Returns:
        The dataclass; ``NoOptions`` for a field that declares none.
    """
    if name in OPTIONS:
        module, kind = OPTIONS[name]
        return getattr(import_module(module), kind)
    if name in BUILT_IN:
        from lightwell.fields.no_options import NoOptions

        return NoOptions
    return find_field(name).Options


def option_homes() -> dict[str, list[str]]:
    """Map the name of each option that only some of the built-in fields have to those fields.

    Returns:
        Name of the option to names of fields.
    """
    from lightwell.core.options import options_of

    homes: dict[str, list[str]] = {}
    for field in OPTIONS:
        for name in options_of(options_type(field)):
            homes.setdefault(name, []).append(field)
    return homes


def field_of(preset: str) -> str:
    """Find the field of a preset that was given without a field.

    Args:
        preset: Name of a preset.

    Returns:
        Name of the first built-in field that has the preset; the default field where none has it.
    """
    return next((name for name, presets in PRESETS.items() if preset in presets), DEFAULT)


def preset_of(name: str, preset: str, quality: str) -> str:
    """Find the preset of a quality.

    Args:
        name: Name of a field.
        preset: The preset that is asked for; any other than the default one stays.
        quality: The quality.

    Returns:
        Name of a preset of the field.
    """
    return QUALITY_PRESETS.get(name, {}).get(quality, preset) if preset == "default" else preset


def check_preset(name: str, preset: str) -> None:
    """Check that a field has a preset.

    Args:
        name: Name of a field.
        preset: Name of a preset.

    Raises:
        ValueError: The field has no such preset.
    """
    presets = PRESETS[name] if name in PRESETS else find_field(name).presets
    if preset not in presets:
        cure = did_you_mean(preset, presets, f"choose one of {', '.join(presets)} with --preset")
        raise ValueError(f"bake: field '{name}' has no preset '{preset}'; {cure}")


@cache
def _added() -> dict[str, Any]:
    return {point.name: point for point in entry_points(group=GROUP)}


def _loaded(name: str) -> Field:
    point = _added()[name]
    try:
        field = point.load()
    except Exception as error:  # Whatever the code of another distribution raises when it is imported.
        raise ValueError(
            f"bake: the field '{name}' of '{point.value}' cannot be loaded ({type(error).__name__}: {error}); "
            "update or remove the distribution that adds it"
        ) from error
    missing = [part for part in ("name", "Options", "presets", "prepare", "sample", "fit") if not hasattr(field, part)]
    if missing:
        raise ValueError(f"bake: the field '{name}' of '{point.value}' lacks {', '.join(missing)}; see docs/python.md")
    return field
