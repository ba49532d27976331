"""Samples of a scene's indirect light as a file, for use outside lightwell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightwell.core.options import check, option
from lightwell.core.scene_options import SceneOptions
from lightwell.core.vary import parse_vary
from lightwell.fields.request import Request

_REQUEST = Request.__dataclass_fields__
# Points that share one position of the light, as in the training samples of fields.
POINTS_PER_LIGHT = 128


@dataclass(frozen=True)
class SampleSettings(SceneOptions):
    """Settings of a file of samples."""

    scene: str
    """Path of a scene or the name of a built-in one."""
    out: Path
    """File to write, .npz."""
    samples: int = option(1 << 16, "surface points, each with a view and a light (default: 65536)", least=1)
    vary: tuple[str, ...] = _REQUEST["vary"]
    paths: int = _REQUEST["paths"]
    seed: int = _REQUEST["seed"]
    own_light: bool = option(False, "the light of the scene's own emitters instead of the light that moves")

    def __post_init__(self) -> None:
        """Refuse values out of range, by the name of their option, and what a file of samples cannot hold."""
        check(self, "samples")
        if self.out.suffix != ".npz":
            raise ValueError(f"samples: '{self.out}' is no .npz; name a file such as samples.npz with -o")
        if moving := [d.text for d in map(parse_vary, self.vary) if d.moves]:
            raise ValueError(f"samples: the scene stands still here; drop '{moving[0]}' from --vary")


def write_samples(settings: SampleSettings) -> dict[str, Any]:
    """Path-trace samples and write them as an .npz of float32 and uint32 arrays of N rows.

    The columns are those of ``lightwell.transport.samples``: ``position, normal, view, light, reflectance, roughness,
    metallic`` (the inputs of a field), ``half_a, half_b, radiance`` (two independent means and their mean, for a light
    of 1 cd or 1 lx, reflectance included), ``weight`` (makes means area-uniform), and ``shape, triangle, barycentric``
    (the location of the point). A file that cannot be written is an ``OSError``.

    Args:
        settings: Settings of the file.

    Returns:
        Facts: file, samples, paths, light; JSON values.

    Raises:
        ValueError: A mistake of the user: one line with the cure.
    """
    from lightwell.files import check_writable, save_arrays
    from lightwell.scenes import load
    from lightwell.scenes.placing import sample_lights
    from lightwell.scenes.variables import declare
    from lightwell.transport import collect, draw_surface
    from lightwell.transport.samples import columns_of

    check_writable(settings.out)
    scene = load(settings.scene, **settings.loading)
    if settings.own_light and not scene.has_static_light:
        raise ValueError(f"samples: scene '{scene.name}' has no light of its own; leave --own-light out")
    variable, count = declare(settings.vary, scene), settings.samples
    draw = draw_surface(scene, count, settings.seed)
    places = sample_lights(scene, variable, math.ceil(count / POINTS_PER_LIGHT), settings.seed)
    light = places.repeat(POINTS_PER_LIGHT, axis=0)[:count]
    options = {"weight": draw.weight, "own_light": settings.own_light}
    found = collect(scene, variable, draw.points, light, settings.paths, settings.seed, **options)
    columns = columns_of(found.query)
    columns |= {name: getattr(found, name) for name in ("half_a", "half_b", "radiance", "weight", "shape")}
    columns |= {"triangle": draw.points.triangle, "barycentric": draw.points.barycentric}
    save_arrays(settings.out, columns)
    kind = "own" if settings.own_light else variable.kind
    return {"file": str(settings.out), "samples": count, "paths_per_sample": settings.paths, "light": kind}
