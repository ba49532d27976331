"""Several fields on the same samples: what is written, that its numbers are those of the assets, and its refusals."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import lightwell.baking.comparison as pipeline
from lightwell.asset.read import read_fields
from lightwell.baking import evaluate
from lightwell.baking.comparison import CompareSettings, compare_fields, parse_fields, table
from lightwell.baking.cost import compressed_bytes
from lightwell.baking.reference import trace_points, trace_view
from lightwell.baking.reference_budget import ReferenceBudget
from lightwell.cli import main
from lightwell.core.work import FOLDER, store_of
from lightwell.fields.baked import Baked
from lightwell.fields.budget import Budget
from lightwell.fields.protocol import Lowered
from lightwell.fields.surface.clock import Clock
from lightwell.fields.surface.field import SurfaceField
from lightwell.report import metrics, picture_metrics
from lightwell.scenes import load
from lightwell.scenes.variables import declare
from lightwell.transport.queries import make_query
from lightwell.transport.seen_shards import PATHS_OF_EACH, RAYS

FIELDS = "mlp:small,mlp:report-20"
ROOT = Path(__file__).parents[2]
# A child process that compares until it is killed.
CHILD = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from tests.baking.test_compare import compare_fields, small
compare_fields(small(Path(sys.argv[2])))
"""


def small(out, **changes) -> CompareSettings:
    """Settings of a comparison that takes seconds."""
    settings = {
        "scene": "cornell",
        "out": out,
        "fields": parse_fields(FIELDS),
        "shards": 2,
        "steps": 20,
        "paths": 8,
        "lights_per_shard": 32,
        "views": 2,
        "view_size": (48, 32),
        "truth": Budget(0.2),
    }
    return CompareSettings(**(settings | changes))


def failing(patch, broken: str, error: BaseException) -> None:
    """Training a preset raises an error from now on."""
    start = SurfaceField.start

    def fail(self, setup, preset, seed):
        if preset == broken:
            raise error
        return start(self, setup, preset, seed)

    patch.setattr(SurfaceField, "start", fail)


def checkpoints(out: Path) -> dict[str, bytes]:
    """File of each field's checkpoint → its bytes, which contain the times of the steps."""
    found = (entry.path for entry in store_of(out).entries() if entry.function == "fit.checkpoint")
    return {path.name: path.read_bytes() for path in found}


@pytest.fixture(scope="module")
def joined(tmp_path_factory):
    """(folder, then, now) of a kept comparison that another field joined: numbers and checkpoints before and after."""
    out = tmp_path_factory.mktemp("compare") / "out"
    first = compare_fields(small(out, fields=parse_fields("mlp:small"), keep=True))
    then = first, checkpoints(out)
    return out, then, (compare_fields(small(out, keep=True, resume=True)), checkpoints(out))


@pytest.fixture(scope="module")
def compared(joined):
    """(folder, numbers) of a comparison of two fields."""
    out, _, (numbers, _) = joined
    return out, numbers


def test_all_files_are_written(compared):
    out, numbers = compared
    written = sorted(p.name for p in out.iterdir() if p.name != FOLDER)
    assert written == ["compare.html", "compare.json", "mlp-report-20", "mlp-small"]
    for field in numbers["fields"]:
        names = sorted(p.name for p in (out / field["folder"]).iterdir())
        assert names == ["index.html", "report.html", "report.json", "scene.glb"]
    assert json.loads((out / "compare.json").read_text()) == numbers


def test_every_field_saw_the_same_samples(compared):
    _, numbers = compared
    assert [field["name"] for field in numbers["fields"]] == ["mlp:small", "mlp:report-20"]
    assert numbers["settings"]["samples"] == 2 * 32 * 128
    # The rays that all samples are gathered from, and the paths of each.
    assert numbers["settings"]["paths_per_sample"] == PATHS_OF_EACH * 8
    assert numbers["paths"] == 8192 * RAYS + 2 * 32 * 128 * PATHS_OF_EACH * 8
    assert {field["steps"] for field in numbers["fields"]} == {20} and not numbers["failed"]
    assert all(field["noise_floor"] == numbers["noise_floor"] for field in numbers["fields"])


def test_the_numbers_are_those_of_the_assets(compared):
    """Traced and scored again from scene.glb alone: the same error, PSNR and cost."""
    out, numbers = compared
    scene = load("cornell")
    variable, budget = declare((), scene), ReferenceBudget(**numbers["settings"]["effort"])
    points = trace_points(scene, variable, "indirect", budget, 0)
    camera, light = evaluate.views_and_lights(scene, variable, 2, 0)[0]
    view = trace_view(scene, variable, camera, light, ("indirect",), (48, 32), budget.pixel_paths)
    for field in numbers["fields"]:
        graph = read_fields(out / field["folder"] / "scene.glb")[0][0].graph
        baked, unit = Baked(graph), numbers["unit"]
        y = 0.5 * (points.half_a + points.half_b) / unit
        found = baked(make_query(scene, points.points, points.light)) / unit
        error = metrics.relative_error(found, y, points.weight)
        assert error.mean == pytest.approx(field["relative_error"], rel=1e-4)
        assert error.p95 == pytest.approx(field["relative_error_p95"], rel=1e-3)
        pictures = np.zeros((2, 32 * 48, 3))
        found = baked(make_query(scene, view.points, view.light)) / unit
        exposed = field["per_view"][0]["exposure_unit"]
        pictures[:, view.seen] = found * unit / exposed, 0.5 * (view.half_a + view.half_b) / exposed
        psnr = picture_metrics.psnr_db(*pictures.reshape(2, 32, 48, 3))
        assert psnr == pytest.approx(field["per_view"][0]["psnr_db"], abs=1e-2)
        cost = (graph.nbytes, graph.macs, graph.fetches, graph.parameters, compressed_bytes(Lowered(graph)))
        keys = ("bytes", "macs_per_pixel", "fetches_per_pixel", "parameters", "compressed_bytes")
        assert cost == tuple(field[key] for key in keys)


def test_a_field_of_a_comparison_is_a_bake(compared, capsys):
    """`view`, `info` and the other form of `compare` take its folder."""
    out, numbers = compared
    folders = [str(out / field["folder"]) for field in numbers["fields"]]
    assert main(["compare", *folders, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["relative_error"] for row in rows] == [field["relative_error"] for field in numbers["fields"]]
    assert main(["info", folders[0]]) == 0
    assert 'id="lightwell-asset"' in (out / "mlp-small/index.html").read_text()


def test_the_table_is_sorted_by_error(compared):
    _, numbers = compared
    errors = sorted(field["relative_error"] for field in numbers["fields"])
    lines = table(numbers["fields"]).splitlines()
    assert len(lines) == 3 and f"{errors[0]:.2%}" in lines[1]


def test_other_fields_join_a_kept_comparison(joined):
    """With --keep, --resume trains only the new field, on the samples that are there."""
    _, (first, before), (again, after) = joined
    assert len(before) == 1 and len(after) == 2 and before.items() <= after.items()
    assert again["fields"][0]["relative_error"] == first["fields"][0]["relative_error"]
    # Tracing again would double them.
    assert again["trace_seconds"] < 1.5 * first["trace_seconds"]


@pytest.mark.slow
def test_killed_and_resumed(tmp_path, compared):
    """kill -9 after the first field: it is not trained again, and the end is that of a comparison never killed."""
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(ROOT), str(tmp_path)], stderr=subprocess.PIPE)
    done, end = tmp_path / "mlp-small/report.json", time.monotonic() + 300
    while not done.exists():
        assert child.poll() is None and time.monotonic() < end, child.stderr.read().decode()
        time.sleep(0.02)
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    assert not (tmp_path / "compare.json").exists()
    # The second field may have one as well.
    before = checkpoints(tmp_path)
    numbers = compare_fields(small(tmp_path, resume=True, keep=True))
    assert any(checkpoints(tmp_path)[name] == data for name, data in before.items())
    for field in numbers["fields"]:
        # The reference's budget depends on the machine's speed at that moment; the learned light does not.
        paths = (root / field["folder"] / "scene.glb" for root in (tmp_path, compared[0]))
        a, b = (read_fields(path)[0][0].graph.buffers for path in paths)
        assert a.keys() == b.keys() and all(np.array_equal(a[k].array, b[k].array) for k in a)


def test_interrupted_by_the_keyboard(tmp_path, capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "loaded", interrupted)
    assert main(["compare", "--fields", "mlp", "cornell", "-o", str(tmp_path), "--json"]) == 130
    assert "--resume" in capsys.readouterr().err


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """(folder, numbers) of a comparison with a time budget, in which one of two fields fails."""
    out = tmp_path_factory.mktemp("failed") / "out"
    few = {"views": 1, "view_size": (24, 16), "shards": 1, "lights_per_shard": 8, "truth": Budget(0.05)}
    with pytest.MonkeyPatch.context() as patch:
        failing(patch, "report-20", RuntimeError("train: loss nan at step 3 is not finite"))
        return out, compare_fields(small(out, steps=None, budget=Budget(1.0), **few))


@pytest.mark.slow
def test_a_field_that_fails_is_left_out_and_nothing_else_is_written(failed):
    out, numbers = failed
    assert [field["name"] for field in numbers["fields"]] == ["mlp:small"]
    assert "not finite" in numbers["failed"]["mlp:report-20"]
    assert "mlp:report-20 failed" in (out / "compare.html").read_text()
    assert sorted(path.name for path in out.iterdir()) == ["compare.html", "compare.json", "mlp-small"]


@pytest.mark.slow
def test_a_time_budget_becomes_steps(failed):
    """Without --steps the time decides; every field gets as much of it, and at least a few steps."""
    (field,) = failed[1]["fields"]
    # On a busy machine a second is few steps.
    assert field["steps"] >= 2 and field["training"][-1]["seconds"] <= field["train_seconds"] + 1e-6


def test_field_names():
    choices = parse_fields(" mlp, mlp:report-20 ,mlp:default")
    assert [choice.name for choice in choices] == ["mlp", "mlp:report-20"]
    assert choices[1].folder == "mlp-report-20"


def _refused(capsys, *argv) -> str:
    """The one line that a refused command prints."""
    assert main([str(a) for a in argv]) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.strip().splitlines()
    assert captured.out == "" and "Traceback" not in line
    return line


def test_refusals(capsys, tmp_path):
    out = tmp_path / "out"
    line = _refused(capsys, "compare", "--fields", "mlp,magic", "cornell", "-o", out)
    assert "unknown field 'magic'" in line and "mlp" in line
    line = _refused(capsys, "compare", "--fields", "mlp:magic", "cornell", "-o", out)
    assert "no preset 'magic'" in line and "mlp:report-20" in line
    assert "names no field" in _refused(capsys, "compare", "--fields", ",", "cornell", "-o", out)
    assert "-o" in _refused(capsys, "compare", "--fields", "mlp", "cornell")
    assert "one scene" in _refused(capsys, "compare", "--fields", "mlp", "cornell", "courtyard", "-o", out)
    assert "--budget" in _refused(capsys, "compare", "--fields", "mlp", "cornell", "-o", out, "--budget", "5%")
    assert "--truth" in _refused(capsys, "compare", "--fields", "mlp", "cornell", "-o", out, "--truth", "5%")
    assert "--views" in _refused(capsys, "compare", "--fields", "mlp", "cornell", "-o", out, "--views", "0")
    assert "--fields" in _refused(capsys, "compare", "cornell", "-o", out)
    assert not out.exists()


def test_a_clock_goes_on_where_it_was_killed():
    clock = Clock()
    clock.mark(10)
    again = Clock(clock.array())
    again.mark(20)
    # Marks that were read and marks that are new lie on one line.
    assert clock.at(10) <= again.at(15) <= again.at(20)
