"""Validates the extension's JSON against its schema, with one-line messages."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from importlib import resources
from itertools import pairwise
from typing import Any

import jsonschema
from jsonschema.exceptions import best_match
from referencing import Registry, Resource

from lightwell.asset.records import EXTENSION, MOVING
from lightwell.core.environment_text import WHOLE_TURN

# Name under which the extension's schema refers to the schema of the shading graph.
GRAPH_SCHEMA = "graph.schema.json"
# Longest quotation of the file's data in an error message, characters.
MAX_QUOTE = 160
# How far the squared length of an axis may be from 1.
UNIT_TOLERANCE = 1e-3


@cache
def validator() -> jsonschema.Draft202012Validator:
    """Load the validator of the schema in the package (a copy of format/LIGHTWELL_neural_radiance.schema.json).

    Returns:
        The validator; the schema of the shading graph is part of it.
    """
    from lightwell.graph import schema

    text = resources.files("lightwell.asset").joinpath(f"{EXTENSION}.schema.json").read_text("utf-8")
    graph = Resource.from_contents(schema())
    return jsonschema.Draft202012Validator(json.loads(text), registry=Registry().with_resource(GRAPH_SCHEMA, graph))


def validate(extension: Any) -> None:
    """Check the extension's JSON against the schema, unique names and existing indices.

    Args:
        extension: JSON of the extension, untrusted.

    Raises:
        ValueError: It breaks a rule; one line that names the place.
    """
    if isinstance(extension, dict) and extension.get("version") == 1 and "probes" in extension:
        # The schema says so too, without a place.
        raise ValueError(f"{EXTENSION}.probes: nothing of that name in version 1; write version 2")
    error = best_match(validator().iter_errors(extension))
    if error is not None:
        message = error.message if len(error.message) <= MAX_QUOTE else error.message[:MAX_QUOTE] + " …"
        raise ValueError(f"{EXTENSION}{error.json_path[1:]}: {message}")
    _check_references(extension)


def _check_references(extension: dict[str, Any]) -> None:
    """Check what a JSON schema cannot express: unique names, and indices that exist."""
    lamps = extension.get("lamps", ())
    for table in ("variables", "fields", "probes", "lamps"):
        names = [entry["name"] for entry in extension.get(table, ())]
        if len(set(names)) < len(names):
            raise ValueError(f"{EXTENSION}.{table}: two entries have the same name")
    for i, variable in enumerate(extension["variables"]):
        where = f"{EXTENSION}.variables[{i}]"
        _check_sky(variable.get("sky"), f"{where}.sky")
        if variable["kind"] == "point" and any(low > high for low, high in zip(variable["low"], variable["high"])):
            raise ValueError(f"{where}.low: expected no number above that of high")
        for name in ("start", "middle", "end") if variable["kind"] == "sun" else ():
            if not any(variable[name]):
                raise ValueError(f"{where}.{name}: expected a direction, found zero")
        if variable["kind"] in ("sun", "environment") and not any(variable["initial"]):
            raise ValueError(f"{where}.initial: expected a direction, found zero")
        if variable["kind"] == "environment" and not 0 < variable["range"][1] - variable["range"][0] <= WHOLE_TURN:
            raise ValueError(f"{where}.range: expected two increasing angles, at most {WHOLE_TURN:g} degrees apart")
    if sum(variable["kind"] == "environment" for variable in extension["variables"]) > 1:
        raise ValueError(f"{EXTENSION}.variables: only one environment can turn")
    _check_surroundings(extension)
    _check_movers(extension)
    for where, field in _graphs(extension):
        if field.get("variable", -1) >= sum(variable["kind"] not in MOVING for variable in extension["variables"]):
            raise ValueError(f"{where}.variable: there is no light {field['variable']}")
        width = field["graph"]["inputs"].get("lamps", 3 * len(lamps))
        if width != 3 * len(lamps):
            raise ValueError(f"{where}.graph.inputs.lamps: width {width}, expected 3 for each of {len(lamps)} lamps")


def _graphs(extension: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield place and JSON of every field, then of all probes."""
    for table in ("fields", "probes"):
        for i, field in enumerate(extension.get(table, ())):
            yield f"{EXTENSION}.{table}[{i}]", field


def _check_surroundings(extension: dict[str, Any]) -> None:
    """Check that the core is a box, and that the environment follows a lamp that exists."""
    core, lamps = extension.get("core"), len(extension.get("lamps", ()))
    if core is not None and any(low >= high for low, high in zip(core["low"], core["high"])):
        raise ValueError(f"{EXTENSION}.core: expected low below high")
    lamp = extension.get("environment", {}).get("lamp", -1)
    if lamp >= lamps:
        raise ValueError(f"{EXTENSION}.environment.lamp: there is no lamp {lamp}")


def _check_movers(extension: dict[str, Any]) -> None:
    """Check that lights come before nodes, that ranges hold their first value, and that graphs have their poses."""
    variables = extension["variables"]
    kinds = [variable["kind"] in MOVING for variable in variables]
    if kinds != sorted(kinds):
        raise ValueError(f"{EXTENSION}.variables: lights come before nodes and clips")
    for i, variable in enumerate(variables):
        if variable["kind"] not in MOVING:
            continue
        low, high = variable["range"]
        if low == high or not min(low, high) <= variable["initial"] <= max(low, high):
            raise ValueError(f"{EXTENSION}.variables[{i}]: expected a range that is not empty and holds initial")
        if variable["kind"] == "node" and abs(sum(c * c for c in variable["axis"]) - 1) > UNIT_TOLERANCE:
            raise ValueError(f"{EXTENSION}.variables[{i}].axis: expected a unit vector")
    for where, field in _graphs(extension):
        width, nodes = field["graph"]["inputs"].get("pose", sum(kinds)), sum(kinds)
        if width != nodes:
            raise ValueError(f"{where}.graph.inputs.pose: width {width}, expected {nodes}, 1 a node or clip")


def _check_sky(sky: dict[str, Any] | None, where: str) -> None:
    """Check that the numbers of a sky are as many as its times, and times and hours in order."""
    if sky is None:
        return
    times, hours = sky["times"], sky.get("hours", (0, 1, 2))
    if times[0] != 0 or times[-1] != 1 or any(a >= b for a, b in pairwise(times)):
        raise ValueError(f"{where}.times: expected increasing numbers from 0 to 1")
    for name in ("level", "sun", "model"):
        if len(sky[name]) != len(times):
            raise ValueError(f"{where}.{name}: expected as many as times, {len(times)}, found {len(sky[name])}")
    if any(a >= b for a, b in pairwise(hours)):
        raise ValueError(f"{where}.hours: expected three increasing hours")
