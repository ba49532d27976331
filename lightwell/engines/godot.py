"""Files for Godot 4: LightmapGIData with an EXR slice and probes, a scene that applies it, shaders of the fields."""

from __future__ import annotations

import numpy as np

from lightwell.engines.bake import Bake
from lightwell.engines.exr_files import exr_bytes
from lightwell.engines.godot_probes import Tree, tetrahedra
from lightwell.engines.probe_grid import ProbeGrid
from lightwell.engines.shaders import shader_files
from lightwell.engines.text import numbers, quoted, render
from lightwell.limits import Limits

# Characters that Godot does not allow in names of nodes (Node.name).
FORBIDDEN = '.:@/"%'
# More cells make a resource of more than 100 MB of text.
MOST_CELLS = 100_000


def files(bake: Bake, limits: Limits | None) -> dict[str, bytes]:
    """Make the files of Godot; too many probes for a text resource are a ``ValueError``.

    Args:
        bake: The bake.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        Content by name: to be put into ``res://lightwell/``.
    """
    made, _ = shader_files(bake, "gdshader", limits)
    if bake.light_map is None and bake.probes is None:
        return made
    image = np.zeros((4, 4, 3), np.float32) if bake.light_map is None else bake.light_map
    made["light_map.exr"] = exr_bytes(image)
    made["light_map.exr.import"] = render("godot.import").encode()
    made["light_map.tres"] = render("godot.tres", users=_users(bake.lit), **_probes(bake.probes)).encode()
    made["lightwell.tscn"] = render("godot.tscn").encode()
    return made


def node_name(name: str) -> str:
    """Give a node's name as Godot's importer does.

    Args:
        name: Name of a glTF node.

    Returns:
        The name, with ``_`` for each character that Godot does not allow.
    """
    return "".join("_" if c in FORBIDDEN else c for c in name)


def _users(lit: tuple[str, ...]) -> str:
    """Path, place in the atlas, slice and instance of every lit mesh, seen from the LightmapGI node."""
    paths = (quoted(f"../Scene/{node_name(name)}") for name in lit)
    return ", ".join(f"NodePath({path}), Rect2(0, 0, 1, 1), 0, -1" for path in paths)


def _probes(grid: ProbeGrid | None) -> dict[str, str]:
    """The probe data as texts of Godot's arrays."""
    if grid is None:
        return {"bounds": numbers([0] * 6), "bsp": "", "points": "", "sh": "", "tetrahedra": ""}
    if grid.lattice.cell_count > MOST_CELLS:
        raise ValueError(
            f"export: {grid.lattice.cell_count} cells of probes, expected at most {MOST_CELLS} for Godot; "
            "bake probes with a larger --spacing"
        )
    points = grid.lattice.nodes()
    # Godot multiplies what it evaluates by the albedo alone: its harmonics are those of radiance / π.
    light = grid.radiance / np.pi
    colors = np.concatenate([light, np.ones((*light.shape[:2], 1))], axis=2)
    return {
        "bounds": numbers([*points.min(axis=0), *np.ptp(points, axis=0)]),
        "bsp": ", ".join(map(str, Tree(grid.lattice).numbers().ravel().tolist())),
        "points": numbers(points.ravel()),
        "sh": numbers(colors.ravel()),
        "tetrahedra": ", ".join(map(str, tetrahedra(grid.lattice).ravel().tolist())),
    }
