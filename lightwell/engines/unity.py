"""Files for Unity: an EXR light map, light of probes, two scripts that import and apply them, HLSL of the fields."""

from __future__ import annotations

import numpy as np

from lightwell.engines.bake import Bake
from lightwell.engines.exr_files import exr_bytes
from lightwell.engines.probe_grid import ODD_IN_X, SIGNS, ProbeGrid
from lightwell.engines.shaders import shader_files
from lightwell.engines.text import numbers, quoted, render
from lightwell.limits import Limits


def files(bake: Bake, limits: Limits | None) -> dict[str, bytes]:
    """Make the files of Unity.

    Args:
        bake: The bake.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        Content by name: to be put into ``Assets/lightwell/``, the script of ``Editor/`` into a folder of that name.
    """
    # Unity's textures begin with the lowest row, where Load and v = 0 read.
    made, _ = shader_files(bake, "hlsl", limits, bottom_up=True)
    if bake.light_map is not None:
        made["light_map.exr"] = exr_bytes(bake.light_map)
    if bake.probes is not None:
        made["probe_light.txt"] = probe_text(bake.probes).encode()
    if bake.probes is not None or any(name.endswith((".exr", ".png")) for name in made):
        made["LightwellLight.cs"] = render("unity_light.cs").encode()
        lit = ", ".join(map(quoted, bake.lit))
        made["Editor/LightwellImport.cs"] = render("unity_import.cs", lit=lit).encode()
    return made


def probe_text(grid: ProbeGrid) -> str:
    """Write probes as lines of numbers.

    Args:
        grid: The probes.

    Returns:
        Position in Unity's axes, then nine harmonics of red, green and blue, a line a probe.
    """
    # glTF's x points the other way in Unity. SphericalHarmonicsL2 evaluates to irradiance / π.
    light = grid.irradiance * SIGNS[:, None] / np.pi
    light[:, ODD_IN_X] *= -1
    places = grid.lattice.nodes() * [-1, 1, 1]
    rows = np.concatenate([places, light.reshape(len(light), -1)], axis=1)
    return "".join(numbers(row).replace(", ", " ") + "\n" for row in rows)
