"""Settings of a picture. The command line is made from this module, so it imports nothing slow."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightwell.core.cluster_options import ClusterOptions
from lightwell.core.environment_text import parse_turn
from lightwell.core.lamps import parse_day, parse_lamps, parse_settings
from lightwell.core.mover_texts import parse_movers
from lightwell.core.options import check, made, option, options_of
from lightwell.core.scene_options import SceneOptions
from lightwell.core.suggest import did_you_mean
from lightwell.core.vary import parse_vary

# Largest picture, pixels; beyond it the accumulated image does not fit into the memory of a small machine.
MOST_PIXELS = 1 << 26
Place = tuple[float, float, float]
# Output variables that a picture can carry; `lightwell.rendering.aov` computes them.
AOVS = ("depth", "motion", "albedo", "normal")


def parse_size(text: str) -> tuple[int, int]:
    """Read the size of a picture from text.

    Args:
        text: Width and height like ``640x400``.

    Returns:
        Width and height, pixels.

    Raises:
        ValueError: The text is not a size, or the picture would be empty or too large.
    """
    match = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text)
    width, height = (int(v) for v in match.groups()) if match else (0, 0)
    if not 0 < width * height <= MOST_PIXELS:
        raise ValueError(f"'{text}' is not a picture; write width x height such as 640x400")
    return width, height


def parse_place(texts: Sequence[str]) -> Place:
    """Read a position from text.

    Args:
        texts: Three numbers, metres.

    Returns:
        The position.

    Raises:
        ValueError: The texts are not three finite numbers.
    """
    try:
        x, y, z = (float(v) for v in texts)
    except ValueError:
        x = y = z = math.nan
    if not all(math.isfinite(v) for v in (x, y, z)):
        raise ValueError(f"{' '.join(texts)} is not a place; write three numbers such as 0 1.5 0")
    return x, y, z


def parse_aovs(text: str) -> tuple[str, ...]:
    """Read names of output variables from text.

    Args:
        text: Names of ``AOVS``, joined by commas.

    Returns:
        The names, each once.

    Raises:
        ValueError: A name is unknown.
    """
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    for name in names:
        if name not in AOVS:
            raise ValueError(f"'{name}' is unknown; {did_you_mean(name, AOVS, f'choose some of {chr(44).join(AOVS)}')}")
    return names


@dataclass(frozen=True)
class PathOptions:
    """Options of ``--integrator path``."""

    deep: int | None = option(
        None, "write a deep .exr with so many surfaces per pixel, one behind the other", least=1, most=64
    )


@dataclass(frozen=True)
class NrcOptions:
    """Options of ``--integrator nrc``, the radiance cache."""

    nrc: tuple[str, ...] = option(
        (),
        "an option of the radiance cache, such as seconds=10, preset=paper, estimator=residual, view=cache",
        metavar="NAME=VALUE",
        repeat=True,
    )
    cache_from: Path | None = option(
        None, "start the cache from a baked scene.glb of the same scene", parse=Path, metavar="GLB"
    )
    frames: int | None = option(None, "an orbit of so many frames; OUT is then a folder", least=1)
    format: str | None = option(None, "format of the frames (default: exr)", choices=("exr", "png"))
    resume: bool = option(False, "keep the frames that are there")
    force: bool = option(False, "overwrite files in OUT that lightwell did not write")

    def __post_init__(self) -> None:
        """Refuse options of a sequence for a single picture."""
        for name in ("format", "resume", "force"):
            if self.frames is None and getattr(self, name):
                raise ValueError(f"render: --{name} is for sequences; add --frames N, or leave it out")
        if self.cache_from is not None and self.frames is not None:
            raise ValueError("render: --cache-from is for single pictures; leave out --frames, or --cache-from")
        if self.cache_from is not None and not Path(self.cache_from).is_file():
            raise ValueError(f"render: --cache-from '{self.cache_from}' does not exist; name the scene.glb of a bake")


def check_picture(path: Path) -> None:
    """Refuse a picture that cannot be written, before anything is loaded.

    Args:
        path: The file.

    Raises:
        ValueError: Its name ends in neither .png nor .exr.
        OSError: Its folder is missing or cannot be written, or a folder has its name.
    """
    if path.suffix.lower() not in (".png", ".exr"):
        raise ValueError(f"render: '{path}' is neither .png nor .exr; choose one of them")
    # Imported here, because it imports NumPy.
    from lightwell.files import check_writable

    check_writable(path)


@dataclass(frozen=True)
class VplOptions:
    """Options of ``--integrator vpl``, virtual point lights."""

    paths: int = option(64, "light paths per sample (default: 64)", least=1, most=1 << 20)
    clamp: float = option(
        100.0,
        "bound on the geometry term times the squared extent of the scene; inf: none (default: 100)",
        check=lambda v: "" if v > 0 else "is no bound; give a positive number, or inf",
    )


@dataclass(frozen=True)
class IrradianceCacheOptions:
    """Options of ``--integrator irradiance-cache``."""

    accuracy: float = option(
        0.3,
        "error at which a record is still used; smaller is denser (default: 0.3)",
        check=lambda v: "" if 0 < v <= 2 else "is out of range; give a number above 0 and at most 2",
    )


INTEGRATORS: dict[str, type] = {
    "path": PathOptions,
    "nrc": NrcOptions,
    "vpl": VplOptions,
    "irradiance-cache": IrradianceCacheOptions,
}


@dataclass(frozen=True)
class RenderSettings(SceneOptions, ClusterOptions):
    """Settings of a picture."""

    scene: str
    """Path of a scene or the name of a built-in one."""
    out: Path
    """Picture to write, .png (tone-mapped) or .exr (linear); a folder for a sequence."""
    size: tuple[int, int] = option(
        (640, 400), "width x height in pixels (default: 640x400)", parse=parse_size, metavar="WxH"
    )
    spp: int = option(128, "light paths per pixel (default: 128)", least=1)
    camera: int = option(0, "index of the scene's camera (default: 0)", least=0)
    light: Place | None = option(
        None, "place of a point light, metres (default: see docs)", parse=parse_place, metavar=("X", "Y", "Z")
    )
    intensity: float | None = option(
        None,
        "candela of that light (default: 1; a .png is then exposed by itself)",
        check=lambda v: "" if 0 < v < math.inf else "is not a light; give a positive number of candela",
    )
    set: tuple[str, ...] = option(
        (),
        "a state of the scene's own lamps, such as desk=0.3 or desk=1,0.8,0.6; light=0 turns the point light off; "
        "day=18:30 is the time of a day that --vary declares, environment.rotation=90 the angle of a map; "
        "node:Door.rotation=45 (degrees about y, or x:45) and "
        "node:Door.translation=(0,0,0.6) (metres) move a node",
        metavar="NAME=DIMMER",
        repeat=True,
    )
    vary: tuple[str, ...] = option(
        (),
        "the sun instead of the point light, as for bake: day=2026-06-21,48.1,11.6 or sun.direction=arc(90,10,270,10); "
        "environment.rotation=0..360 turns the environment map",
        metavar="WHAT=RANGE",
        repeat=True,
    )
    lamps: tuple[str, ...] = option(
        (), "groups of the scene's own lamps, as for bake", metavar="NAME=PATTERN", repeat=True
    )
    seed: int = option(0, "seed of the random numbers (default: 0)", least=0)
    integrator: str = option(
        "path", "path, nrc (the radiance cache), or a baseline: vpl, irradiance-cache", choices=tuple(INTEGRATORS)
    )
    aov: tuple[str, ...] = option(
        (), f"further channels of an .exr, joined by commas: {', '.join(AOVS)}", parse=parse_aovs, metavar="NAME,…"
    )
    options: Any = None
    """Options of the integrator: an instance or a dictionary; None: the defaults."""

    def __post_init__(self) -> None:
        """Refuse values out of range, by the name of their option."""
        check(self, "render")
        parse_lamps(self.lamps)
        parse_settings(parse_turn(parse_day(parse_movers(self.set)[1])[1])[1])
        if (self.set or self.vary) and self.integrator != "path":
            given = "--set" if self.set else "--vary"
            raise ValueError(f"render: {given} is for --integrator path; leave one of them out")
        for text in self.vary:
            parse_vary(text)
        if self.set and self.cluster:
            raise ValueError("render: --set is for this machine alone; leave out --cluster")
        if self.options is None or isinstance(self.options, Mapping):
            object.__setattr__(self, "options", _options(self.integrator, self.options or {}))
        deep = getattr(self.options, "deep", None)
        if deep and (Path(self.out).suffix.lower() != ".exr" or self.aov):
            raise ValueError(f"render: --deep writes an .exr without --aov, not '{self.out}'; name one with -o")
        if self.aov and (Path(self.out).suffix.lower() != ".exr" or getattr(self.options, "frames", None)):
            raise ValueError(f"render: --aov is for a single .exr, not '{self.out}'; name one with -o, or leave it out")


def _options(integrator: str, given: Mapping[str, Any]) -> Any:
    homes: dict[str, list[str]] = {}
    for name, kind in INTEGRATORS.items():
        for option_name in options_of(kind):
            homes.setdefault(option_name, []).append(name)
    return made(INTEGRATORS[integrator], given, "render", "integrator", integrator, homes)
