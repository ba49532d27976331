"""Arguments of the verbs that bake. Outside their room, because entering that starts Mitsuba; help is instant."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from lightwell import limit_arguments

if TYPE_CHECKING:
    from lightwell.baking.settings import BakeSettings


def add(parser: argparse.ArgumentParser) -> None:
    """Options of ``bake`` and ``demo`` beside scene and folder."""
    parser.add_argument(
        "--field", help="learned representation, or lightmap (default: factored, or the one that has the preset)"
    )
    parser.add_argument(
        "--preset", default="default", help="settings of the field, e.g. default, report-20, report-200"
    )
    parser.add_argument(
        "--budget",
        metavar="TIME|ERROR",
        default=None,
        help="60s, 5m, 1h of tracing and training, or 5%% of error on validation lights (default: 2m; demo: 60s)",
    )
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="WHAT=RANGE",
        help="what may move: light.position=box(x0,y0,z0,x1,y1,z1), light.radius=r, sun.direction=arc(az0,el0,az1,el1) "
        "in degrees, light.clearance=c; light.intensity and light.color set what may always change "
        "(default: what the scene suggests, else a point light anywhere in its air)",
    )
    parser.add_argument("--seed", type=int, default=0, help="the same seed and plan give the same result (default: 0)")
    parser.add_argument(
        "--paths", type=int, default=16, help="light paths per training sample, even (default: %(default)s)"
    )
    parser.add_argument("--views", type=int, default=4, help="held-out views in the report (default: %(default)s)")
    parser.add_argument("--no-static", action="store_true", help="leave out the light of the scene's own emitters")
    parser.add_argument(
        "--steps",
        type=int,
        help="fixed number of training steps per field, instead of a time budget (early stopping may end them)",
    )
    parser.add_argument(
        "--shards",
        type=int,
        help="fixed number of 65,536-sample shards per field, instead of a time budget; a quarter more is adaptive",
    )
    parser.add_argument(
        "--size",
        type=int,
        help="lightmap: texels along each edge of the atlas (default: 1024, or 2048 where charts are small)",
    )
    parser.add_argument(
        "--mips", type=int, default=1, help="lightmap: mip level up to which charts do not mix (default: %(default)s)"
    )
    parser.add_argument(
        "--max-bytes", metavar="SIZE", help="lightmap: the best that fits, 1MB or 250kB, by short trial fits"
    )
    parser.add_argument(
        "--spacing", metavar="LENGTH", help="probes: distance of neighbouring probes, 1m or 50cm (default: extent / 8)"
    )
    parser.add_argument(
        "--rebake",
        metavar="OLD",
        help="probes: an edit of the bake in OLD (made with --keep); only what --box touches is baked again",
    )
    parser.add_argument("--box", metavar="x0,y0,z0,x1,y1,z1", help="probes: where the scene has changed, metres")
    parser.add_argument("--resume", action="store_true", help="go on with a bake that was interrupted")
    parser.add_argument("--keep", action="store_true", help="keep samples and checkpoints after the bake")
    limit_arguments.add_scene(parser)
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print report.json to standard output, no progress bars")


def add_force(parser: argparse.ArgumentParser) -> None:
    """The option that overwrites files of others in an output folder."""
    parser.add_argument("--force", action="store_true", help="overwrite files in OUT that lightwell did not write")


def settings(arguments: argparse.Namespace) -> BakeSettings:
    """What the options say, checked."""
    from lightwell.baking.lightmap_bytes import parse_bytes
    from lightwell.baking.settings import BakeSettings, Budget, metres

    budget = Budget.parse(arguments.budget) if arguments.budget else Budget()
    return BakeSettings(
        scene=arguments.scene,
        out=Path(arguments.out),
        field=arguments.field or "",
        preset=arguments.preset,
        budget=budget,
        vary=tuple(arguments.vary),
        seed=arguments.seed,
        resume=arguments.resume,
        paths=arguments.paths,
        views=arguments.views,
        steps=arguments.steps,
        shards=arguments.shards,
        keep=arguments.keep,
        force=arguments.force,
        static=not arguments.no_static,
        size=arguments.size,
        mips=arguments.mips,
        max_bytes=None if arguments.max_bytes is None else parse_bytes(arguments.max_bytes),
        spacing=None if arguments.spacing is None else metres(arguments.spacing),
        **limit_arguments.scene_options(arguments),
    )
