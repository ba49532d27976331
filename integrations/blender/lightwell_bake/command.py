"""The command line of a bake, from plain values. Nothing here needs Blender."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

# Distance that a lamp keeps from surfaces, metres.
CLEARANCE = 0.1


@dataclass(frozen=True)
class Request:
    """What a bake is asked for."""

    scene: Path
    """The exported GLB."""
    out: Path
    """Folder to write."""
    field: str = "surface"
    """'surface' (light that follows a lamp), 'lightmap' or 'probes'."""
    quality: str = "good"
    """'draft', 'good' or 'best'."""
    budget: float = 0.0
    """Seconds of the whole bake; 0 takes the time of the quality."""
    vary: tuple[str, ...] = ()
    """Values of --vary."""
    log: Path | None = None
    """File that progress is written to."""


def bake_command(program: Sequence[str], request: Request) -> list[str]:
    """Write the command line of a bake.

    Args:
        program: Words that start lightwell, such as ``["lightwell"]``.
        request: What is asked for.

    Returns:
        The words of the command.
    """
    words = [*program, "bake", str(request.scene), "-o", str(request.out), "--quality", request.quality, "--json"]
    if request.field != "surface":
        words += ["--field", request.field]
    if request.budget > 0:
        words += ["--budget", f"{request.budget:g}s"]
    for declaration in request.vary:
        words += ["--vary", declaration]
    if request.log is not None:
        words += ["--log", str(request.log)]
    return words


def to_gltf(point: Sequence[float]) -> tuple[float, float, float]:
    """Turn Blender's axes (z up) to glTF's (y up).

    Args:
        point: [3] position or direction in Blender's world.

    Returns:
        The same in glTF's.
    """
    x, y, z = point
    return (x, z, -y)


def lamp_box(position: Sequence[float], reach: Sequence[float]) -> tuple[str, ...]:
    """Declare a lamp that moves within a box.

    Args:
        position: [3] the lamp in Blender's world, metres.
        reach: [3] how far it moves each way along Blender's axes, metres, ≥ 0.

    Returns:
        Values of --vary.
    """
    center, half = to_gltf(position), [abs(r) for r in to_gltf(reach)]
    low = ",".join(f"{c - h:.6g}" for c, h in zip(center, half))
    high = ",".join(f"{c + h:.6g}" for c, h in zip(center, half))
    return (f"light.position=box({low},{high})", f"light.clearance={CLEARANCE:g}")


def sun_arc(start: Sequence[float], end: Sequence[float]) -> tuple[str, ...]:
    """Declare a sun that moves along an arc.

    Args:
        start: [2] azimuth and elevation in radians.
        end: [2] the same at its end.

    Returns:
        Values of --vary.
    """
    numbers = ",".join(f"{math.degrees(angle):.6g}" for angle in (*start, *end))
    return (f"sun.direction=arc({numbers})",)
