"""The learned fields against the report that they start from, against each other, and against the bars of the topic.

    python benchmarks/radiance_fields.py                       every part (about 90 minutes on 2 cores)
    python benchmarks/radiance_fields.py --only cornell,rooms
    python benchmarks/radiance_fields.py --quick               a smoke run of about a minute; writes nothing

Parts: `report` (its networks and mixtures, in its own slab of light and with the light anywhere), `cornell` (ours, on
the Cornell box), `bytes` (ours against experts and kd-tree of its size), `seams` (experts with overlap), `rooms` (three
given rooms), `more-rooms` (a harder one). Each is a comparison as `lightwell compare --fields … SCENE -o OUT` makes it:
the fields of a part learn from the same samples and are scored as they ship, on lights, views and points that training
never saw. Parts on the Cornell box with the light anywhere share one comparison. Each has a page, OUT/…/compare.html. A
part that was killed goes on with --resume. Rows go into results/radiance_fields.json.

The light roams the box at a distance of at least a tenth of its size from every surface, and a room at a tenth of its
shortest edge: nearer to a wall the indirect field is singular. Given scenes that are not on this machine are skipped.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import mean
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from rows import Row, at_least, at_most, chosen, publish, without_bar

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT.parent / "shared" / "scenes"

# The field that the bars are asked of, and the one with experts that seams are asked of: FIELD or FIELD:PRESET.
OURS, SEGMENTED = "factored", "balanced"
# What stands in for either while it does not exist.
FALLBACK = "mlp"

CORNELL = SCENES / "mitsuba/cornell-box/scene.xml"
# Room: scene; distance that the light keeps from surfaces, a tenth of the shortest edge as in the box; seconds
# of tracing and training, on which no bar is set.
ROOMS = {
    "godot-living-room": (SCENES / "gltf/godot-living-room/living_room.glb", 0.55, 320.0),
    "godot-room": (SCENES / "gltf/godot-room/room.glb", 0.5, 320.0),
    "veach-ajar": (SCENES / "mitsuba/veach-ajar/scene_mi3.xml", 0.38, 300.0),
}
# A fourth, full of small furniture, that no bar is asked of.
MORE_ROOMS = {"room-soft-shadows": (SCENES / "gltf/room-soft-shadows/room-decoded.glb", 2.6, 320.0)}
# Preset of a room, whose bar on bytes is higher than the box's, and seconds of its truth.
ROOM_PRESET, ROOM_TRUTH = "large", 60.0
# Distance that the light keeps from every surface of the Cornell box, which is 2 m wide.
ROAMING = ("light.clearance=0.2",)
# The report's own light: a slab in front of the open box, x and y in 100 … 400 and z in −100 … 0 of a box of about 550,
# here in a box of 2 m whose open side is at z = 1.
SLAB = ("light.position=box(-0.64,0.36,1.0,0.45,1.45,1.36)",)

REPORT_FIELDS = ("mlp:report-200", "mlp:report-20", "kdtree:report", "experts:report")
# The report's models, of which the bar is asked, and our own kd-tree, which shares the inputs of ours.
BASELINES, ALSO = ("experts:report", "kdtree:report"), ("kdtree",)
# Ours counts as "at equal bytes" when it has at most this many times the bytes of the baseline.
EQUAL_BYTES = 1.1

# Seconds of tracing and training in all: the bar, of which half traces and half trains.
BUDGET = 175.0
# Seconds of tracing the truth of a part: a bar of 38 dB needs pictures whose own noise is far above that.
TRUTH = 120.0
# Objects with fewer held-out points than this have no error worth a verdict.
FEWEST_POINTS = 24


@dataclass(frozen=True)
class Run:
    """How this benchmark was called."""

    out: Path
    quick: bool
    resume: bool
    budget: float
    truth: float = TRUTH
    """Seconds of tracing the truth."""
    begun: dict[str, list] = field(default_factory=dict)
    """Comparisons of this run and their fields: parts that share one add theirs to it."""


def ours() -> tuple[str, str]:
    """(field, preset) of ``OURS``, or of what stands in for it."""
    choice = _choices((OURS,)) or _choices((FALLBACK,))
    return choice[0].field, choice[0].preset


def _choices(names: tuple[str, ...]) -> list:
    """Those of the named fields that exist."""
    from lightwell.baking.comparison import parse_fields

    found = []
    for name in names:
        try:
            found += parse_fields(name)
        except ValueError:
            continue
    return found


def compared(run: Run, name: str, scene: Path | str, fields: list, vary: tuple[str, ...] = ()) -> dict[str, Any]:
    """compare.json of a comparison in OUT/NAME, with ``by_name``: the entries of its fields by name."""
    from lightwell.baking.comparison import CompareSettings, compare_fields
    from lightwell.core.progress import Progress
    from lightwell.fields.budget import Budget

    resume = run.resume or name in run.begun
    every = run.begun.setdefault(name, [])
    every += [choice for choice in fields if choice not in every]
    settings = CompareSettings(
        scene=str(scene),
        out=run.out / name,
        fields=tuple(every),
        budget=Budget(run.budget),
        vary=vary,
        truth=Budget(2.0 if run.quick else run.truth),
        resume=resume,
        keep=True,
    )
    if run.quick:
        tiny = {"shards": 2, "steps": 20, "lights_per_shard": 32, "views": 1, "view_size": (64, 40), "paths": 4}
        settings = replace(settings, **tiny)
    numbers = compare_fields(settings, Progress())
    return numbers | {"by_name": {field["name"]: field for field in numbers["fields"]}}


def _note(numbers: dict[str, Any], field: dict[str, Any]) -> str:
    return (
        f"{field['name']}: floor {numbers['noise_floor']:.2%}, median {field['relative_error_median']:.2%}, "
        f"{field['psnr_db']:.1f} dB (ceiling {numbers['psnr_ceiling_db']:.1f}), energy {field['energy_ratio']:.3f}, "
        f"{field['bytes'] / 1e3:.1f} kB, {field['macs_per_pixel']} MAC, {field['fetches_per_pixel']} fetches, "
        f"{numbers['trace_seconds']:.0f} + {field['train_seconds']:.0f} s, {field['steps']} steps"
    )


def _missing(rows: list[Row], why: str) -> list[Row]:
    """The same rows, not measured."""
    return [replace(row, measured=None, holds=None, note=why) for row in rows]


# ---------------------------------------------------------------------- parts


def report(run: Run) -> list[Row]:
    """The report's networks and mixtures in its own setting and in ours, beside what it says of them."""
    rows = []
    for setting, vary in (("light slab of the report", SLAB), ("light anywhere", ROAMING)):
        name = "slab" if vary == SLAB else "cornell"
        if not CORNELL.exists():
            return _missing(_report_rows(setting, None), "the scene is not on this machine")
        rows += _report_rows(setting, compared(run, name, CORNELL, _choices(REPORT_FIELDS), vary))
    return rows


def _report_rows(setting: str, numbers: dict[str, Any] | None) -> list[Row]:
    """Claim by claim; a field that does not exist, or failed, is not measured."""
    by_name = numbers["by_name"] if numbers else {}

    def figure(name: str, key: str) -> tuple[str, float | None, str]:
        """What it is, how large, and a note."""
        field = by_name.get(name)
        value = field and (field["facts"].get("leaves") if key == "leaves" else field[key])
        return f"report, {name}, {setting}", value, _note(numbers, field) if field else "not in this version"

    rows = []
    for name, bar, sign in (("mlp:report-200", 0.01, at_most), ("mlp:report-20", 0.08, at_least)):
        what, value, note = figure(name, "relative_error")
        rows.append(sign(f"{what}: error", bar, value, "of 1", note))
    # The kd-tree is to stop at an error of 5 % in every leaf.
    what, value, note = figure("kdtree:report", "relative_error")
    rows.append(at_most(f"{what}: error", 0.05, value, "of 1", note))
    what, value, note = figure("kdtree:report", "leaves")
    rows.append(at_least(f"{what}: leaves", 6000, value, "leaves", note))
    # The report gives no error for its experts.
    what, value, note = figure("experts:report", "relative_error")
    rows.append(without_bar(f"{what}: error", value, "of 1", note))
    return rows


def cornell(run: Run) -> list[Row]:
    """Ours on the Cornell box with the light anywhere in its air."""
    choice, scene = _ours(), CORNELL if CORNELL.exists() else "cornell"
    numbers = compared(run, "cornell", scene, [choice], ROAMING)
    field = numbers["by_name"][choice.name]
    note = _note(numbers, field)
    seconds = numbers["trace_seconds"] + field["train_seconds"]
    return [
        at_most("Cornell box, ours: relative error", 0.05, field["relative_error"], "of 1", note),
        at_least("Cornell box, ours: PSNR", 38, field["psnr_db"], "dB", note),
        at_most(
            "Cornell box, ours: bytes as stored", 300e3, field["bytes"], "B", f"{field['compressed_bytes']} by zlib"
        ),
        at_most("Cornell box, ours: multiply-adds per pixel", 1500, field["macs_per_pixel"], "MAC", note),
        at_most("Cornell box, ours: tracing and training", 180, seconds, "s", note),
        at_most("Cornell box, ours: energy ratio less 1", 0.02, abs(field["energy_ratio"] - 1), "of 1", note),
    ]


def _ours():
    from lightwell.baking.comparison import FieldChoice

    return FieldChoice(*ours())


def equal_bytes(run: Run) -> list[Row]:
    """How many times lower the error of ours is than that of a baseline with as many bytes."""
    from lightwell.baking.comparison import FieldChoice
    from lightwell.fields.registry import find_field

    field, _ = ours()
    sizes = [FieldChoice(field, preset) for preset in find_field(field).presets]
    baselines = _choices(BASELINES + ALSO)
    scene = CORNELL if CORNELL.exists() else "cornell"
    numbers = compared(run, "cornell", scene, [*sizes, *baselines], ROAMING)
    found = numbers["by_name"]
    rows = [_equal(name, found, [s.name for s in sizes]) for name in BASELINES + ALSO]
    rows = [replace(row, asked="–", holds=None) if name in ALSO else row for row, name in zip(rows, BASELINES + ALSO)]
    return rows + [_error(numbers, field) for field in numbers["fields"]]


def _error(numbers: dict[str, Any], field: dict[str, Any]) -> Row:
    """The error of one field beside all others of the same samples."""
    what = f"Cornell box, same samples: error of {field['name']}"
    return without_bar(what, 100 * field["relative_error"], "%", _note(numbers, field))


def _equal(name: str, found: dict[str, Any], sizes: list[str]) -> Row:
    """The largest of ours that is not larger than the baseline; without one, the row is not measured."""
    what = f"Cornell box: error of {name} over ours at equal bytes"
    baseline = found.get(name)
    if baseline is None:
        return at_least(what, 3, None, "ratio", "not in this version")
    small = [found[s] for s in sizes if s in found and found[s]["bytes"] <= EQUAL_BYTES * baseline["bytes"]]
    if not small:
        least = min((found[s] for s in sizes if s in found), key=lambda field: field["bytes"])
        ratio = baseline["relative_error"] / least["relative_error"]
        note = f"no preset of ours is as small: {least['name']} has {least['bytes']} B, {name} {baseline['bytes']} B"
        return at_least(what, 3, None, "ratio", f"{note}; at unequal bytes {ratio:.2f}")
    best = max(small, key=lambda field: field["bytes"])
    note = ", ".join(f"{f['name']} {f['relative_error']:.2%} in {f['bytes'] / 1e3:.1f} kB" for f in (best, baseline))
    return at_least(what, 3, baseline["relative_error"] / best["relative_error"], "ratio", note)


def seams(run: Run) -> list[Row]:
    """Error beside the borders between experts over that of the interior."""
    what = "Cornell box, experts with overlap: border over interior error"
    choices = _choices((SEGMENTED,))
    if not choices:
        return [at_most(what, 1.2, None, "ratio", f"{SEGMENTED} is not in this version")]
    scene = CORNELL if CORNELL.exists() else "cornell"
    numbers = compared(run, "cornell", scene, choices, ROAMING)
    field = numbers["by_name"].get(choices[0].name)
    note = f"{field['segments']} experts in view; {_note(numbers, field)}" if field else "its training failed"
    bar = at_most(what, 1.2, field["border_ratio"] if field else None, "ratio", note)
    return [bar, _error(numbers, field)] if field else [bar]


def rooms(run: Run) -> list[Row]:
    """Ours in three rooms that nobody here made."""
    return _rooms(run, ROOMS)


def more_rooms(run: Run) -> list[Row]:
    """Ours in a harder room."""
    return _rooms(run, MORE_ROOMS)


def _rooms(run: Run, scenes: dict[str, tuple[Path, float, float]]) -> list[Row]:
    rows = []
    for name, (path, clearance, seconds) in scenes.items():
        if path.exists():
            rows += _room(run, name, path, clearance, seconds)
        else:
            rows.append(
                at_most(f"{name}, ours: relative error", 0.08, None, "of 1", "the scene is not on this machine")
            )
    return rows


def _room(run: Run, name: str, path: Path, clearance: float, seconds: float) -> list[Row]:
    from lightwell.baking.comparison import FieldChoice

    choice = FieldChoice(ours()[0], ROOM_PRESET)
    longer = replace(run, budget=run.budget if run.quick else seconds, truth=ROOM_TRUTH)
    numbers = compared(longer, f"room-{name}", path, [choice], (f"light.clearance={clearance}",))
    field = numbers["by_name"][choice.name]
    note = _note(numbers, field)
    objects = [row for row in field["per_object"] if row["points"] >= FEWEST_POINTS] or field["per_object"]
    worst = max(objects, key=lambda row: row["relative_error"])
    of_mean = worst["relative_error"] / field["relative_error"]
    typical = mean(row["noise_floor"] for row in objects)
    about = f"{worst['name']}: {worst['relative_error']:.1%}, its floor {worst['noise_floor']:.1%} (mean {typical:.1%})"
    return [
        at_most(f"{name}, ours: relative error", 0.08, field["relative_error"], "of 1", note),
        at_most(f"{name}, ours: bytes as stored", 250e3, field["bytes"], "B", note),
        at_most(f"{name}, ours: worst object over the scene's mean error", 3, of_mean, "ratio", about),
        at_most(f"{name}, ours: energy ratio less 1", 0.02, abs(field["energy_ratio"] - 1), "of 1", note),
        without_bar(
            f"{name}, ours: tracing and training", numbers["trace_seconds"] + field["train_seconds"], "s", note
        ),
    ]


PARTS = {
    "report": report,
    "cornell": cornell,
    "bytes": equal_bytes,
    "seams": seams,
    "rooms": rooms,
    "more-rooms": more_rooms,
}


def main() -> None:
    """Measure the chosen parts; each is published when it is done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a smoke run; writes nothing")
    parser.add_argument("--only", help=f"comma-separated parts of: {', '.join(PARTS)}")
    parser.add_argument("--out", type=Path, default=ROOT / "out/radiance-fields", help="folder of the comparisons")
    parser.add_argument("--resume", action="store_true", help="go on with comparisons that are in --out")
    parser.add_argument("--budget", type=float, default=BUDGET, help="seconds of a bake (default: %(default)s)")
    arguments = parser.parse_args()
    names = chosen("--only", arguments.only, PARTS)
    out = arguments.out / "quick" if arguments.quick else arguments.out
    run = Run(out, arguments.quick, arguments.resume, 6.0 if arguments.quick else arguments.budget)
    for name in names:
        publish("radiance_fields", PARTS[name](run), arguments.quick)


if __name__ == "__main__":
    main()
