"""The state that an incremental bake needs of the bake before it, as named arrays: rays, trust, records and samples.

The reader checks every shape, type and index against the lattice before it is used. Large arrays are float32,
because everything that an edit does not touch keeps its bytes.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np

from lightwell.files import Arrays, under
from lightwell.probes import bricks
from lightwell.probes.assemble import BrickLevel, ProbeRecords, assemble
from lightwell.probes.bake import Geometry
from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.light import SolvedVolume
from lightwell.probes.pattern import POINTS, Pattern, pattern
from lightwell.probes.samples import ProbeSampling
from lightwell.probes.sheets import Sheets
from lightwell.probes.solve import Solution, SolveRows
from lightwell.probes.support import CLOSE, Support
from lightwell.probes.volume import WEIGHTED, Bricks
from lightwell.probes.weights import FUNCTIONS

VERSION = 5
_SUPPORT = {"slot": "i4", "near": "f4", "source": "i4", "origin": "f4", "alive": "?"}
_ROWS = {"place": "f4", "normal": "f4", "light": "f4", "cell": "i8", "noise": "f8"}


def state_arrays(lit: SolvedVolume, facts: dict[str, Any], more: dict[str, np.ndarray]) -> Arrays:
    """Collect the state of a bake.

    Args:
        lit: The bake.
        facts: JSON values of the caller.
        more: Arrays of any shape of the caller, by name.

    Returns:
        Arrays of any shape by name.
    """
    arrays = {f"more.{name}": value for name, value in more.items()}
    for k, (level, found) in enumerate(zip(lit.geometry.levels, lit.geometry.records)):
        s = level.support
        arrays |= {f"{k}.{name}": getattr(s, name) for name in _SUPPORT}
        arrays |= {f"{k}.valid": np.packbits(s.valid, axis=1), f"{k}.free": np.packbits(s.free, axis=1)}
        arrays |= {f"{k}.nodes": level.nodes, f"{k}.target": level.target}
        arrays |= {f"{k}.sheets.{name}": getattr(level.sheets, name) for name in ("row", "plane", "corners")}
        arrays |= {f"{k}.state": found.state, f"{k}.params": found.params, f"{k}.octant": found.octant}
    volume = lit.geometry.volume
    arrays |= {"first": lit.geometry.first, "fallback": volume.fallback, "start": lit.start, "number": lit.number}
    if volume.bricks is not None:
        arrays |= {f"bricks.{name}": getattr(volume.bricks, name) for name in ("cell", "table", "inner")}
    arrays |= {f"rows.{name}": np.asarray(getattr(lit.samples, name)) for name in _ROWS}
    arrays |= {"light": lit.solution.light, "orphans": lit.solution.orphans, "residual": lit.solution.residual}
    if lit.lights is not None:
        arrays["lights"] = lit.lights
    head = {
        "version": VERSION,
        "origin": volume.lattice.origin.tolist(),
        "spacing": volume.lattice.spacing,
        "shape": list(volume.lattice.shape),
        "function": volume.function,
        "offset": volume.offset,
        "errors": list(lit.solution.errors),
        "effort": asdict(lit.sampling),
        "seed": lit.seed,
        "facts": facts,
    }
    return arrays | {"head": np.frombuffer(json.dumps(head).encode(), np.uint8)}


def state_of(arrays: Arrays) -> tuple[SolvedVolume, dict[str, Any], dict[str, np.ndarray]]:
    """Restore and check the state of a bake.

    Args:
        arrays: Result of ``state_arrays``, arrays of any shape by name.

    Returns:
        The bake, and ``facts`` and ``more`` of the caller.

    Raises:
        ValueError: The arrays are not the state of a bake; one line.
    """
    try:
        head = json.loads(arrays["head"].tobytes())
        return _read(head, arrays), dict(head["facts"]), under("more", arrays)
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise ValueError(f"not the state of light probes ({' '.join(str(error).split())[:80]})") from error


def _read(head: dict[str, Any], arrays: dict[str, np.ndarray]) -> SolvedVolume:
    _check(head["version"] == VERSION and head["function"] in FUNCTIONS, "version or weights")
    shape = tuple(int(n) for n in head["shape"])
    _check(len(shape) == 3 and min(shape) >= 2 and max(shape) <= 1 << 12, "shape")
    spacing, origin = float(head["spacing"]), np.array(head["origin"], np.float64)
    _check(0 < spacing < 1e6 and origin.shape == (3,) and bool(np.isfinite(origin).all()), "lattice")
    lattice = ProbeLattice(origin, spacing, shape)
    kept = _bricks(arrays, lattice)
    levels, found = [], []
    parts = [(lattice, pattern(POINTS)), (bricks.fine_lattice(lattice), pattern(bricks.FINE_POINTS))]
    for k, (grid, layout) in enumerate(parts[: 1 if kept is None else 2]):
        level = _level(under(str(k), arrays), grid, layout)
        levels.append(level)
        found.append(_records(under(str(k), arrays), len(level.nodes), FUNCTIONS[head["function"]].parameters))
    _check(np.array_equal(levels[0].nodes, np.arange(len(lattice))), "nodes")
    count = sum(len(level.nodes) for level in levels)
    _check(kept is None or (kept.table.max() < count and len(kept.inner) == count - len(lattice)), "bricks")
    first, fallback = (_array(arrays, n, "i4", (lattice.cell_count, 8)) for n in ("first", "fallback"))
    _check(all(a.min() >= -1 and a.max() < len(lattice) for a in (first, fallback)), "fallbacks")
    fine = None if kept is None else (levels[1], found[1], kept)
    volume = assemble(levels[0], head["function"], found[0], fallback, fine)
    geometry = Geometry(volume, tuple(levels), tuple(found), first, {})
    return _lit(head, arrays, geometry, count)


def _lit(head: dict[str, Any], arrays: dict[str, Any], geometry: Geometry, count: int) -> SolvedVolume:
    lights = _array(arrays, "lights", "f4", (None, 3)) if "lights" in arrays else None
    states = () if lights is None else (len(lights),)
    total = len(arrays["number"])
    number = _array(arrays, "number", "i8", (total,))
    shapes = {"place": (total, 3), "normal": (total, 3), "light": (*states, total, 9, 3)}
    values = {
        name: _array(arrays, f"rows.{name}", kind, shapes.get(name, (total,)), name in ("place", "cell"))
        for name, kind in _ROWS.items()
    }
    _check(not total or 0 <= values["cell"].min() <= values["cell"].max() < geometry.volume.lattice.cell_count, "cells")
    start, light = (_array(arrays, name, "f4", (*states, count, 9, 3)) for name in ("start", "light"))
    residual = np.asarray(arrays["residual"], np.float64)
    solution = Solution(light, _array(arrays, "orphans", "?", (total,)), tuple(map(float, head["errors"])), residual)
    _check(residual.shape == (total,), "residual")
    wanted = {name: type(value) for name, value in asdict(ProbeSampling()).items()}
    sampling = ProbeSampling(**{name: kind(head["effort"][name]) for name, kind in wanted.items()})
    _check(
        2 <= sampling.paths <= 1 << 20 and 2 <= sampling.probe_paths <= 1 << 20 and 1 <= sampling.most <= 64, "effort"
    )
    return SolvedVolume(geometry, start, SolveRows(**values), number, solution, sampling, int(head["seed"]), lights)


def _level(arrays: dict[str, Any], lattice: ProbeLattice, layout: Pattern) -> BrickLevel:
    slot = _array(arrays, "slot", "i4", (lattice.cell_count,))
    rows = int((slot >= 0).sum())
    _check(np.array_equal(slot[slot >= 0], np.arange(rows)), "cells")
    points, edges, nodes = len(layout.points), len(layout.start), len(lattice)
    shapes = {"near": (rows, CLOSE, 3), "source": (rows, CLOSE), "origin": (nodes, 3), "alive": (nodes,)}
    parts = {name: _array(arrays, name, _SUPPORT[name], shape) for name, shape in shapes.items()}
    _check(not rows or parts["source"].max(initial=-1) < points, "places")
    bits = {name: _array(arrays, name, "u1", (rows, -(-n // 8))) for name, n in (("valid", points), ("free", edges))}
    valid, free = (np.unpackbits(bits[name], axis=1, count=n) > 0 for name, n in (("valid", points), ("free", edges)))
    support = Support(lattice, layout, slot, valid, free, **parts)
    chosen = _array(arrays, "nodes", "i8", (None,))
    _check(len(chosen) > 0 and chosen.min() >= 0 and chosen.max() < nodes, "nodes")
    target = _array(arrays, "target", "f2", (len(chosen), len(layout.u) + 8 * CLOSE))
    return BrickLevel(support, chosen, target, _sheets(under("sheets", arrays), slot))


def _sheets(arrays: dict[str, Any], slot: np.ndarray) -> Sheets:
    row = _array(arrays, "row", "i4", slot.shape)
    used = row >= 0
    count = int(used.sum())
    _check(np.array_equal(row[used], np.arange(count)) and bool((slot[used] >= 0).all()), "cells of sheets")
    return Sheets(row, _array(arrays, "plane", "f4", (count, 4)), _array(arrays, "corners", "u2", (count,)))


def _records(arrays: dict[str, Any], nodes: int, parameters: int) -> ProbeRecords:
    state = _array(arrays, "state", "u1", (nodes,))
    count = int((state == WEIGHTED).sum())
    _check(state.max(initial=0) <= WEIGHTED, "states")
    params = _array(arrays, "params", "f4", (count, parameters))
    return ProbeRecords(state, params, _array(arrays, "octant", "u8", (count,)))


def _bricks(arrays: dict[str, Any], lattice: ProbeLattice) -> Bricks | None:
    if "bricks.cell" not in arrays:
        return None
    cell = _array(arrays, "bricks.cell", "i4", (lattice.cell_count,))
    table = _array(arrays, "bricks.table", "i4", (None, 64))
    _check(-1 <= cell.min() and cell.max() < len(table) and table.min() >= len(lattice), "bricks")
    none = np.full((len(table), bricks.FINE**3), -1, np.int32)
    return Bricks(cell, table, _array(arrays, "bricks.inner", "?", (None,)), none)


def _array(arrays: dict[str, Any], name: str, kind: str, shape: tuple[Any, ...], cast: bool = False) -> np.ndarray:
    """An array of a type and shape (None: any length), finite; with ``cast`` the size of its numbers may differ."""
    value = arrays[name]
    same = value.dtype == np.dtype(kind) or (cast and value.dtype.kind == np.dtype(kind).kind)
    fits = value.ndim == len(shape) and all(b is None or a == b for a, b in zip(value.shape, shape))
    _check(same and fits, f"{name} of {kind} {shape}, found {value.dtype} {value.shape}")
    _check(value.dtype.kind != "f" or bool(np.isfinite(value).all()), f"finite {name}")
    return value


def _check(good: bool, expected: str) -> None:
    if not good:
        raise ValueError(f"expected {expected}")
