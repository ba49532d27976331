"""What engines are given of a bake: the scene, its light map, its probes, and the names of the lit meshes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.asset.container import read_file, refusing
from lightwell.asset.read import read_fields, refuse_moving
from lightwell.asset.records import FieldEntry
from lightwell.engines.light_map import light_map
from lightwell.engines.probe_grid import ProbeGrid, read_grid
from lightwell.limits import Limits

# Second set of texture coordinates, the light map's (format/LIGHTMAP.md).
SECOND_UV = "TEXCOORD_1"
# Name of the asset in the folder of a bake.
ASSET = "scene.glb"


@dataclass(frozen=True)
class Bake:
    """A bake, read for an engine."""

    path: Path
    """The GLB."""
    fields: tuple[FieldEntry, ...]
    """Its learned fields."""
    light_map: np.ndarray | None
    """[H, W, 3] float32 diffuse light, irradiance / π, row 0 at v = 0; None where no field reads such coordinates."""
    lit: tuple[str, ...]
    """Names of the nodes whose meshes have light-map coordinates."""
    probes: ProbeGrid | None
    """Irradiance probes on a lattice; None where the bake has none."""


def read_bake(path: str | Path, limits: Limits | None = None) -> Bake:
    """Read a bake for an engine; an asset that is not valid or exceeds the limits is a ``ValueError``.

    Args:
        path: A GLB, or the folder of a bake; probes are read from the folder's .lwp files.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        The bake. Light that depends on a variable is that of the variable's first value.
    """
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    asset = folder / ASSET if Path(path).is_dir() else Path(path)
    fields, variables = read_fields(asset, limits)
    # Light map and probes of an engine are numbers of one pose.
    refuse_moving(fields, "export", "take one field with --to gdshader, hlsl or another shading language, or ")
    document, _ = read_file(asset, limits)
    with refusing(asset):
        lit = lit_nodes(document)
    image = light_map(fields, variables) if lit else None
    files = sorted(folder.glob("probes-*.lwp")) if Path(path).is_dir() else []
    plain = [file for file in files if not file.stem.endswith("-compare")]
    return Bake(asset, tuple(fields), image, lit, read_grid(plain, limits) if plain else None)


def lit_nodes(document: dict[str, Any]) -> tuple[str, ...]:
    """Name the nodes whose meshes have light-map coordinates.

    Args:
        document: JSON of the asset.

    Returns:
        Their names, in the order of the file; a node without one is called ``node_N``.
    """
    meshes = document.get("meshes", [])
    names = []
    for i, node in enumerate(document.get("nodes", [])):
        if "mesh" not in node:
            continue
        if any(SECOND_UV in primitive["attributes"] for primitive in meshes[node["mesh"]]["primitives"]):
            names.append(str(node.get("name") or f"node_{i}"))
    return tuple(names)


def expect_light(bake: Bake, needs_map: bool = False) -> None:
    """Refuse a bake that holds nothing that an engine without our shaders can take.

    Args:
        bake: The bake.
        needs_map: Whether the engine has no use for probes.

    Raises:
        ValueError: The bake has no light map and no probes that could be used.
    """
    if bake.light_map is not None or (bake.probes is not None and not needs_map):
        return
    lacks, cure = ("no light map", "") if needs_map else ("neither a light map nor probes", " or --field probes")
    raise ValueError(f"export: '{bake.path}' has {lacks}; bake with --field lightmap{cure}")
