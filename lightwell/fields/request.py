"""Settings that every field shares. The command line is made from this module, so it imports nothing slow."""

from __future__ import annotations

from dataclasses import dataclass

from lightwell.core.lamps import MODES, parse_lamps
from lightwell.core.options import option
from lightwell.core.vary import of_options
from lightwell.fields.budget import DEFAULT_QUALITY, QUALITY_SECONDS, Budget


@dataclass(frozen=True, kw_only=True)
class Request:
    """Settings of a bake that every field shares. With fixed ``steps`` and ``shards``, the same seed gives the same
    learned light, bit for bit.
    """

    preset: str = option("default", "settings of the field, e.g. default, report-20, report-200", group="what learns")
    quality: str = option(
        DEFAULT_QUALITY,
        "draft, good or best: about 30 s, 3 min or 20 min on two cores, and at most 100, 300 or 1,000 kB "
        "(default: good)",
        choices=tuple(QUALITY_SECONDS),
        group="how long, how good",
    )
    budget: Budget = option(
        Budget(),
        "60s, 5m, 1h for the whole bake from loading to writing, or 5%% of error on validation lights "
        "(default: the time of the quality; demo: 170s)",
        parse=Budget.parse,
        metavar="TIME|ERROR",
        group="how long, how good",
    )
    vary: tuple[str, ...] = option(
        (),
        "what may move: light.position=box(x0,y0,z0,x1,y1,z1), light.radius=r, day=2026-06-21,48.1,11.6 (sun and "
        "sky), sun.direction=arc(az0,el0,az1,el1) in degrees, light.clearance=c, node:Door.rotation=y:0..90 (a node of "
        "the file, degrees), node:NAME.translation=(x,y,z)..(x,y,z) (metres), environment.rotation=0..360 (its map, "
        "degrees); light.intensity and light.color set "
        "what may always change (default: what the scene suggests, else a point light anywhere in its air)",
        metavar="WHAT=RANGE",
        repeat=True,
        group="what may move",
    )
    north: float | None = option(
        None,
        "where north is, degrees clockwise from -Z seen from above, for a sun (default: 0)",
        check=lambda v: "" if abs(v) <= 360 else "is no angle; give -360 to 360 degrees",
        group="what may move",
    )
    sky: bool = option(False, "give the sun of an arc the sky of a clear day", group="what may move")
    turbidity: float | None = option(
        None,
        "haze of the air, 1 (clear) to 10; gives an arc its sky too (default: 3 for a day and for --sky)",
        group="what may move",
    )
    lamps: tuple[str, ...] = option(
        (),
        'switches of the scene\'s own lights: "desk=Desk*" groups lights by name or material, '
        + ", ".join(MODES)
        + " group all of them (repeatable; default: none)",
        metavar="NAME=PATTERN",
        repeat=True,
        group="what may move",
    )
    seed: int = option(
        0, "the same seed and plan give the same result (default: 0)", least=0, group="how long, how good"
    )
    paths: int = option(
        16,
        "light paths per training sample, even; light of a moving lamp that was reflected once has twice as many "
        "(default: 16)",
        least=2,
        check=lambda n: "is odd; give an even number (two independent halves)" if n % 2 else "",
        group="how long, how good",
    )
    static: bool = option(
        True, "leave out the light of the scene's own emitters", flag="--no-static", group="what may move"
    )
    steps: int | None = option(
        None,
        "fixed number of training steps per field, instead of a time budget (early stopping may end them)",
        least=1,
        group="how long, how good",
    )
    shards: int | None = option(
        None,
        "fixed number of 65,536-sample shards per field, instead of a time budget; a quarter more is adaptive",
        least=1,
        group="how long, how good",
    )
    lights_per_shard: int = 512
    """Light positions per shard; 128 surface points share each."""

    def __post_init__(self) -> None:
        """Take the time of the quality where neither a time nor an error is asked for."""
        parse_lamps(self.lamps)
        object.__setattr__(self, "vary", of_options(self.vary, self.sky, north=self.north, turbidity=self.turbidity))
        if self.quality in QUALITY_SECONDS:
            object.__setattr__(self, "budget", self.budget.or_of(self.quality))
