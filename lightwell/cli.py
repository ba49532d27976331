"""The command line: thin verbs over the Python API. Imports are inside the verbs, so that ``--help`` is instant."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import lightwell
from lightwell import bake_arguments, limit_arguments
from lightwell.interrupts import Interrupts

# Exit codes: 2 is the user's mistake (one line says which), 130 is an interrupt, as shells expect.
USAGE_ERROR, INTERRUPTED = 2, 130

EXAMPLES = """\
examples
  lightwell demo                                     the main job on a built-in scene
  lightwell bake room.glb -o out                     learn the light of your scene, two minutes
  lightwell bake room.glb -o out --budget 10m        ... better, in ten minutes
  lightwell bake room.glb -o out --budget 5%         ... until the error is five per cent
  lightwell bake cornell -o out --vary "light.position=box(-0.8,0.2,-0.8,0.8,1.8,0.8)"
  lightwell bake house.xml -o out --vary "sun.direction=arc(90,10,270,10)"
  lightwell view out                                 open the page
  lightwell lens frame.exr -o out.exr --focus 2.5m --fstop 1.8 --focal 50mm    depth of field and motion blur
  lightwell compare out-a out-b                      two bakes side by side
  lightwell compare --fields mlp,factored cornell -o fields    train fields on the same samples and compare them
"""


class _Parser(argparse.ArgumentParser):
    """Says a mistake in one line, as every other mistake here; --help lists the arguments."""

    def error(self, message: str):
        if "expected one argument" in message:
            message += " (a value that begins with '-' is written --name=-value)"
        self.exit(USAGE_ERROR, f"{self.prog}: {message}; {self.prog} --help lists the arguments\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="lightwell",
        description="Learns the indirect light of a scene and plays it back in real time.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"lightwell {lightwell.__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for add in (
        _add_bake,
        _add_demo,
        _add_view,
        _add_render,
        _add_live,
        _add_lens,
        _add_compare,
        _add_info,
        _add_export,
        _add_validate,
        _add_store,
        _add_doctor,
    ):
        add(verbs)
    return parser


def _verb(verbs, name: str, run, summary: str, description: str = "") -> argparse.ArgumentParser:
    parser = verbs.add_parser(
        name,
        help=summary,
        description=description or summary,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    return parser


# ---------------------------------------------------------------------- bake


def _add_bake(verbs) -> None:
    parser = _verb(
        verbs,
        "bake",
        _bake,
        "learn the indirect light of a scene; write scene.glb, index.html, report.html and report.json",
        "Path-trace a scene, fit a small network to its indirect light, and write\n"
        "  OUT/scene.glb     an ordinary glTF that carries the learned light\n"
        "  OUT/index.html    a page in which you orbit and move the light\n"
        "  OUT/report.html   how far it is from the truth\n"
        "  OUT/report.json   the same as numbers\n"
        "Ctrl-C keeps a checkpoint; --resume goes on.",
    )
    parser.add_argument(
        "scene", metavar="SCENE", help="a .glb, .gltf or Mitsuba .xml, or cornell, courtyard, two-rooms"
    )
    parser.add_argument("-o", "--out", required=True, help="folder to write")
    bake_arguments.add(parser)


def _bake(arguments) -> int:
    from lightwell.baking import bake
    from lightwell.baking.progress import Progress

    progress = Progress(quiet=arguments.json)
    if arguments.rebake or arguments.box:
        report = _rebake(arguments, progress)
    else:
        report = bake(bake_arguments.settings(arguments), progress)
    if arguments.json:
        print(json.dumps(report, indent=1))
    return 0


def _rebake(arguments, progress):
    from lightwell.baking.probes_rebake import parse_box, rebake
    from lightwell.core.output import BAKE_FILES, output_folder

    if not (arguments.rebake and arguments.box):
        raise ValueError("bake: --rebake OLD and --box x0,y0,z0,x1,y1,z1 belong together; give both")
    if arguments.field not in (None, "probes"):
        raise ValueError(f"bake: --rebake is for --field probes, not '{arguments.field}'")
    box = parse_box(arguments.box)
    vary, options = tuple(arguments.vary), limit_arguments.scene_options(arguments)
    with output_folder(Path(arguments.out), "bake", BAKE_FILES, arguments.force) as out:
        return rebake(arguments.scene, out, Path(arguments.rebake), box, vary, progress, **options)


# Seconds of tracing and training of the demo: with installation, evaluation and report three minutes on two cores.
DEMO_BUDGET = "60s"


def _add_demo(verbs) -> None:
    parser = _verb(verbs, "demo", _demo, "run the main job on a built-in scene and open the page")
    parser.add_argument(
        "scene", nargs="?", default="courtyard", help="cornell, courtyard or two-rooms (default: %(default)s)"
    )
    parser.add_argument("-o", "--out", default="demo", help="folder to write (default: %(default)s)")
    parser.add_argument("--no-open", action="store_true", help="do not serve or open the page afterwards")
    bake_arguments.add(parser)
    parser.set_defaults(budget=DEMO_BUDGET, views=3)


def _demo(arguments) -> int:
    bake_arguments.settings(arguments)
    code = _bake(argparse.Namespace(**vars(arguments)))
    page = Path(arguments.out) / "index.html"
    if arguments.no_open or not sys.stdout.isatty():
        print(f"open {page} in a browser, or run: lightwell view {arguments.out}", file=sys.stderr)
        return code
    from lightwell.serve import view

    view(arguments.out)
    return code


# ---------------------------------------------------------------------- look


def _add_view(verbs) -> None:
    parser = _verb(verbs, "view", _view, "serve a baked folder on this machine and open the page")
    parser.add_argument("out", metavar="OUT", help="a folder written by bake")
    parser.add_argument("--port", type=int, default=0, help="port on 127.0.0.1 (default: any free one)")
    parser.add_argument("--no-open", action="store_true", help="only serve")


def _view(arguments) -> int:
    from lightwell.serve import view

    view(arguments.out, arguments.port, not arguments.no_open)
    return 0


def _add_render(verbs) -> None:
    from lightwell import cache_arguments as cache

    parser = _verb(
        verbs,
        "render",
        _render,
        "path-trace a picture of a scene (the truth that bakes are measured against)",
    )
    parser.add_argument("scene", metavar="SCENE", help="a .glb, .gltf or Mitsuba .xml, or a built-in name")
    parser.add_argument("-o", "--out", required=True, help="picture to write: .png (tone-mapped) or .exr (linear)")
    parser.add_argument("--size", default="640x400", help="width x height in pixels (default: %(default)s)")
    parser.add_argument("--spp", type=int, default=128, help="light paths per pixel (default: %(default)s)")
    parser.add_argument("--camera", type=int, default=0, help="index of the scene's camera (default: %(default)s)")
    parser.add_argument(
        "--light", nargs=3, metavar=("X", "Y", "Z"), help="place of a point light, metres (default: a good one)"
    )
    parser.add_argument(
        "--intensity", type=float, help="candela of that light (default: 1; a .png is then exposed by itself)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the random numbers (default: 0)")
    cache.add_render(parser)
    limit_arguments.add_scene(parser)
    parser.add_argument("--json", action="store_true", help="print what was rendered as JSON")


def _add_live(verbs) -> None:
    from lightwell import cache_arguments as cache

    cache.add_live(_verb(verbs, "live", _live, cache.LIVE_SUMMARY))


def _live(arguments) -> int:
    from lightwell.cache.command import run_live

    return run_live(arguments)


def _render(arguments) -> int:
    from lightwell.baking.picture import parse_size, render_picture

    if arguments.integrator == "nrc":
        from lightwell.cache.command import run_render

        return run_render(arguments, parse_size(arguments.size))

    facts = render_picture(
        arguments.scene,
        Path(arguments.out),
        size=arguments.size,
        spp=arguments.spp,
        camera=arguments.camera,
        light=arguments.light,
        intensity=arguments.intensity,
        seed=arguments.seed,
        **limit_arguments.scene_options(arguments),
    )
    print(
        json.dumps(facts, indent=1)
        if arguments.json
        else f"{arguments.out}: {facts['width']}x{facts['height']}, {facts['seconds']:.1f} s"
    )
    return 0


def _add_lens(verbs) -> None:
    from lightwell.lens import arguments as lens

    lens.add(_verb(verbs, "lens", _lens, lens.SUMMARY, lens.DESCRIPTION))


def _lens(arguments) -> int:
    from lightwell.lens.command import run

    return run(arguments)


def _add_compare(verbs) -> None:
    parser = _verb(
        verbs,
        "compare",
        _compare,
        "train several fields on the same samples and compare them, or show the reports of several bakes",
        "lightwell compare OUT OUT …                      reports of bakes side by side\n"
        "lightwell compare --fields A,B,… SCENE -o OUT    train each field on the same samples and write\n"
        "  OUT/compare.html   table, charts and pictures of all fields\n"
        "  OUT/compare.json   the same as numbers\n"
        "  OUT/FIELD/         scene.glb, page and report of each field, as bake writes them\n"
        "Ctrl-C keeps what is done; --resume goes on.",
    )
    parser.add_argument("targets", metavar="OUT|SCENE", nargs="+", help="folders written by bake, or one scene")
    parser.add_argument(
        "--fields", metavar="FIELD[:PRESET],…", help="fields to train, for example mlp,mlp:report-20,factored"
    )
    parser.add_argument("-o", "--out", help="folder to write")
    parser.add_argument(
        "--budget",
        metavar="TIME",
        help="60s, 5m, 1h: half of it traces the samples, once, half trains each field (default: 2m)",
    )
    parser.add_argument("--vary", action="append", default=[], metavar="WHAT=RANGE", help="what may move, as in bake")
    parser.add_argument("--seed", type=int, default=0, help="seed of everything (default: 0)")
    parser.add_argument(
        "--paths", type=int, default=16, help="light paths per training sample, even (default: %(default)s)"
    )
    parser.add_argument("--views", type=int, default=3, help="held-out views (default: %(default)s)")
    parser.add_argument("--truth", metavar="TIME", help="time for tracing the truth (default: a share of the budget)")
    parser.add_argument("--steps", type=int, help="training steps of every field, fixed, instead of a time")
    parser.add_argument("--shards", type=int, help="shards of 65,536 samples, fixed, instead of a share of the budget")
    parser.add_argument("--resume", action="store_true", help="go on with a comparison that was interrupted")
    parser.add_argument(
        "--keep", action="store_true", help="keep samples and truth; --resume with other --fields then adds to them"
    )
    limit_arguments.add_scene(parser)
    bake_arguments.add_force(parser)
    parser.add_argument("--json", action="store_true", help="print the rows or compare.json, no progress bars")


def _compare(arguments) -> int:
    if arguments.fields is not None:
        return _compare_fields(arguments)
    from lightwell.baking.compare import comparison, table

    if arguments.out:
        raise ValueError("compare: -o needs --fields; name the fields to train, for example --fields mlp,mlp:report-20")
    rows = comparison([Path(out) for out in arguments.targets])
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))
    return 0


def _compare_fields(arguments) -> int:
    from lightwell.baking.compare_fields import compare_fields, table
    from lightwell.baking.compare_settings import CompareSettings, parse_fields
    from lightwell.baking.progress import Progress
    from lightwell.baking.settings import Budget

    if len(arguments.targets) != 1:
        raise ValueError(f"compare: --fields wants one scene, not {len(arguments.targets)}; name it once")
    if not arguments.out:
        raise ValueError("compare: --fields wants a folder to write; name it with -o")
    settings = CompareSettings(
        scene=arguments.targets[0],
        out=Path(arguments.out),
        fields=parse_fields(arguments.fields),
        budget=Budget.parse(arguments.budget) if arguments.budget else Budget(),
        vary=tuple(arguments.vary),
        truth=Budget.parse(arguments.truth) if arguments.truth else None,
        **limit_arguments.scene_options(arguments),
        **{k: getattr(arguments, k) for k in ("seed", "resume", "paths", "views", "steps", "shards", "keep", "force")},
    )
    numbers = compare_fields(settings, Progress(quiet=arguments.json))
    print(json.dumps(numbers, indent=1) if arguments.json else table(numbers["fields"]))
    return 0


def _add_info(verbs) -> None:
    parser = _verb(verbs, "info", _info, "say what a baked asset or a scene holds")
    parser.add_argument("path", metavar="ASSET|SCENE", help="OUT, OUT/scene.glb, or any scene")
    limit_arguments.add_scene(parser)
    parser.add_argument("--json", action="store_true", help="print the facts as JSON")


def _info(arguments) -> int:
    from lightwell.baking.information import describe

    facts = describe(arguments.path, **limit_arguments.scene_options(arguments))
    if arguments.json:
        print(json.dumps(facts, indent=1))
    else:
        for key, value in facts.items():
            print(f"{key:<14} {value}")
    return 0


def _add_export(verbs) -> None:
    parser = _verb(verbs, "export", _export, "print a learned field as one self-contained shader text")
    parser.add_argument("path", metavar="OUT", help="a folder written by bake, or a .glb")
    parser.add_argument("--to", required=True, metavar="LANGUAGE", help="glsl, wgsl or shadertoy")
    parser.add_argument("-o", "--out", help="file to write, and what it binds beside it (default: beside the asset)")
    parser.add_argument("--field", default="", help="name of the field (default: the first)")
    parser.add_argument("--name", default="lightwell", help="name of the function (default: %(default)s)")
    parser.add_argument(
        "--weights", default="", help="inline (literals) or table (default: by the size of the network)"
    )
    limit_arguments.add_limit(parser)


def _export(arguments) -> int:
    from lightwell.asset.export import ENDINGS, export_field, write_export

    path = Path(arguments.path)
    names = {"field": arguments.field, "name": arguments.name, "weights": arguments.weights}
    exported = export_field(path, arguments.to, **names, limits=limit_arguments.limits(arguments))
    folder = path if path.is_dir() else path.parent
    out = Path(arguments.out) if arguments.out else folder / f"{arguments.name}{ENDINGS[arguments.to]}"
    for written in write_export(out, exported):
        print(f"{written}: {written.stat().st_size} bytes")
    return 0


def _add_validate(verbs) -> None:
    parser = _verb(verbs, "validate", _validate, "check a .glb against the specification of its learned light")
    parser.add_argument("path", metavar="OUT", help="a folder written by bake, or a .glb")
    limit_arguments.add_limit(parser)


def _validate(arguments) -> int:
    from lightwell.asset.validate import validate_file

    problems = validate_file(arguments.path, limit_arguments.limits(arguments))
    print("\n".join(problems) or f"{arguments.path}: follows the specification")
    return 1 if problems else 0


def _add_store(verbs) -> None:
    from lightwell import store_command as store

    parser = _verb(verbs, "store", store.run, store.SUMMARY, store.DESCRIPTION)
    store.add(parser)


def _add_doctor(verbs) -> None:
    parser = _verb(verbs, "doctor", _doctor, "say which backend runs here, and what to do when one does not")
    parser.add_argument("--json", action="store_true", help="print the facts as JSON")


def _doctor(arguments) -> int:
    from lightwell import doctor

    report = doctor.report()
    if arguments.json:
        print(json.dumps(report, indent=1))
    else:
        print(report["machine"])
        for check in report["checks"]:
            cure = f"\n{'':14}{check['cure']}" if check["cure"] and (not check["ok"] or check["name"] == "gpu") else ""
            print(f"{'ok  ' if check['ok'] else 'FAIL'} {check['name']:<9}{check['found']}{cure}")
    return 0 if all(check["ok"] for check in report["checks"]) else 1


# ---------------------------------------------------------------------- main


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; a user's mistake is one line on standard error and exit code 2, never a traceback."""
    arguments = argparse.Namespace(verb="")
    with Interrupts() as interrupts:
        try:
            _parser().parse_args(argv, arguments)
            return arguments.run(arguments)
        except KeyboardInterrupt:
            return _interrupted(arguments)
        except BrokenPipeError:
            return 0
        except Exception as error:
            if interrupts.received:
                return _interrupted(arguments)
            if not isinstance(error, (ValueError, OSError, RuntimeError)):
                raise
            print(f"lightwell: {_one_line(error)}", file=sys.stderr)
            return USAGE_ERROR


def _interrupted(arguments: argparse.Namespace) -> int:
    """Say what an interrupt leaves, except at servers, which end in no other way."""
    if arguments.verb not in ("", "view", "live"):
        long = arguments.verb in ("bake", "demo") or getattr(arguments, "fields", None)
        resume = "; the checkpoint is kept, go on with --resume" if long else ""
        print(f"lightwell: interrupted{resume}", file=sys.stderr)
    return INTERRUPTED


def _one_line(error: BaseException) -> str:
    """What happened and, for a bare error of the operating system, its cure."""
    text = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, OSError) and text.startswith("[Errno"):
        from lightwell.files import CURES

        cure = CURES.get(error.errno or 0, "")
        return f"{error.strerror}: {error.filename or 'output'}{'; ' + cure if cure else ''}"
    return text


if __name__ == "__main__":
    sys.exit(main())
