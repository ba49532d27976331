"""What fails after tracing and training is a note of the report: the asset and its page are written all the same."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.asset.read import read_fields
from lightwell.baking import evaluate, pipeline, reference
from lightwell.baking.late_notes import LateNotes
from lightwell.baking.pipeline import bake
from lightwell.core.progress import Progress
from lightwell.transport.samples import SurfacePoints

from .conftest import small


def broken(*arguments, **options):
    raise ValueError("report: the reference is black, so that no relative error exists; is the light on?")


# Where a failure is planted: the module, the function, and a word of the note.
STAGES = {
    "points": (reference, "trace_points", "surface points"),
    "view": (reference, "trace_view", "the score of"),
    "sweep": (reference, "trace_sweep", "path of the light"),
    "chain": (evaluate, "light_sweep", "path of the light"),
    "picture": (reference, "reference_picture", "reference picture of"),
}


def test_a_failure_becomes_a_note_and_the_rest_goes_on():
    notes = LateNotes(Progress(quiet=True))
    assert notes.attempt("a", lambda: 1, 0) == 1 and notes.attempt("b", broken, 0) == 0
    assert len(notes.texts) == 1 and notes.texts[0].startswith("b could not be made")
    with pytest.raises(OSError, match="full"):
        notes.attempt("c", lambda: (_ for _ in ()).throw(OSError(28, "the disk is full")), 0)
    # What an encoder of pictures raises is no error of the disk.
    assert notes.attempt("d", lambda: (_ for _ in ()).throw(OSError("broken data stream")), 0) == 0


def test_a_chain_without_points_has_no_errors():
    """Those stand still: where several things move, they may carry all that there is."""
    none, nothing = np.zeros((0, 3), np.float32), np.zeros(0, np.uint32)
    points = SurfacePoints(nothing, nothing, np.zeros((0, 2), np.float32), none)
    swept = reference.SweepReference(points, none, none, none, nothing)
    assert evaluate.light_sweep(swept, SimpleNamespace(fit=SimpleNamespace(unit=1.0))) == []


# Several at once, and each alone; a view that is not traced has no reference picture.
@pytest.mark.parametrize(
    "stages",
    [("points", "sweep", "picture"), *(pytest.param((s,), marks=pytest.mark.slow) for s in STAGES)],
    ids="+".join,
)
def test_a_late_failure_costs_no_bake(stages, tmp_path, monkeypatch):
    for module, function, _ in (STAGES[stage] for stage in stages):
        monkeypatch.setattr(module, function, broken)
    # Beside what fails, it shows that a declared sun reaches the asset.
    report = bake(small(tmp_path / "out", steps=10, views=1, shards=1, vary=("sun.direction=arc(100,20,260,20)",)))
    (variable,) = read_fields(tmp_path / "out/scene.glb")[1]
    assert variable["kind"] == "sun"
    for _, _, word in (STAGES[stage] for stage in stages):
        assert any(word in note for note in report["warnings"])
    for name in ("scene.glb", "index.html", "report.html", "report.json"):
        assert (tmp_path / "out" / name).stat().st_size > 1000
    assert json.loads((tmp_path / "out/report.json").read_text()) == report


@pytest.mark.slow
def test_a_bare_report_and_a_page_without_pictures_are_better_than_none(tmp_path, monkeypatch):
    """The figures cannot be computed, and the page cannot hold the pictures of the same bake."""
    written, pages = [], []

    def once(out, data, write=pipeline.write_report):
        written.append(data)
        return broken() if len(written) == 1 else write(out, data)

    def picky(path, views=(), write=pipeline.write_page, **options):
        pages.append(bool(views))
        return broken() if views else write(path, **options)

    monkeypatch.setattr(pipeline, "write_report", once)
    monkeypatch.setattr(pipeline, "write_page", picky)
    # Beside what fails, it shows a light map whose light moves.
    field = {"field": "lightmap", "options": {"size": 64, "mips": 0}}
    vary = ("light.position=box(-0.5,1.2,-0.5,0.5,1.6,0.5)",)
    report = bake(small(tmp_path / "out", steps=10, views=1, shards=1, paths=4, lights_per_shard=8, vary=vary, **field))
    fields, variables = read_fields(tmp_path / "out/scene.glb")
    assert [f.role for f in fields] == ["indirect"] and variables[0]["kind"] == "point"
    assert {"light", "uv1"} <= set(fields[0].graph.inputs)
    assert report["relative_error"] is None and any("the figures" in note for note in report["warnings"])
    assert pages == [True, False] and (tmp_path / "out/index.html").stat().st_size > 1000
