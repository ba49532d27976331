"""The bake of a light map, end to end and small."""

import base64
import copy
import dataclasses
import gzip
import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from lightwell.asset import read_fields
from lightwell.asset.container import unpack
from lightwell.asset.page_textures import with_smaller_textures
from lightwell.asset.records import FieldEntry
from lightwell.asset.without_ktx2 import without_ktx2
from lightwell.asset.write import glb_bytes
from lightwell.baking.pipeline import bake
from lightwell.baking.settings import BakeSettings, request_of
from lightwell.cli import main
from lightwell.core.formats import JSON
from lightwell.core.progress import Progress
from lightwell.core.work import Work, WorkPart, store_of
from lightwell.fields.budget import Budget
from lightwell.fields.lightmap import fitting
from lightwell.fields.lightmap.field import LightmapField
from lightwell.fields.lightmap.fit import PRESETS
from lightwell.fields.lightmap.square import AtlasLimits, roomy_atlas
from lightwell.fields.protocol import Job
from lightwell.fields.request import Request
from lightwell.scenes import load
from tests.plain_glb import write_plain

QUIET = Progress(quiet=True)
# Few samples: the shards of a test are small.
SMALL = dict(
    field="lightmap", budget=Budget(1.0), options={"size": 64, "mips": 0}, paths=4, views=1, view_size=(24, 16),
    shards=1, steps=20, lights_per_shard=8, truth=Budget(0.05),
)  # fmt: skip


def keep_network(patch) -> None:
    """A hundred noisy samples cannot tell whether so few steps of training are better than none."""
    patch.setattr(fitting, "shown_error", lambda fit, samples: 0.0 if fit.preset.hidden else 1.0)


@pytest.fixture
def kept(monkeypatch):
    """A network that is kept."""
    keep_network(monkeypatch)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """(folder, report) of a bake from beginning to end, whose network is kept."""
    out = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        keep_network(patch)
        return out, bake(BakeSettings("cornell", out, **SMALL))


@pytest.fixture(scope="module")
def sampled(tmp_path_factory):
    """A prepared scene and its samples."""
    return lit(LightmapField(), BakeSettings("cornell", tmp_path_factory.mktemp("samples"), **SMALL))


def lit(field: LightmapField, settings: BakeSettings):
    """(state, samples) of a field, as a bake makes them."""
    scene = load("cornell")
    job = Job(scene, Request(**request_of(settings)), settings.options, Work(settings, scene.digest), QUIET)
    state = field.prepare(job)
    return state, field.sample(state, "static")


def fitted(sampled, out, progress=None, options=None, preset="default", **request):
    """A fit of the same samples with other settings."""
    state, samples = copy.copy(sampled[0]), sampled[1]
    settings = BakeSettings("cornell", out, **SMALL | {"options": SMALL["options"] | (options or {})} | request)
    work = Work(settings, state.scene.digest)
    job = Job(state.scene, Request(**request_of(settings)), settings.options, work, progress or QUIET)
    state.job, state.preset = job, PRESETS[preset]
    return LightmapField().fit(state, "static", samples)


def test_default(whole):
    out, report = whole
    fields, variables = read_fields(out / "scene.glb")
    assert [f.role for f in fields] == ["static"] and variables == []
    assert {"e", "f0", "f1", "f2"} <= set(fields[0].graph.buffers)
    assert report["field"] == "lightmap" and np.isfinite(report["psnr_db"])
    assert report["facts"]["atlas"]["charts"] > 5
    assert any("white sky" in w for w in report["warnings"])
    assert json.loads((out / "report.json").read_text())["bytes"] == report["bytes"]
    document, _ = unpack((out / "scene.glb").read_bytes())
    assert all("MOZ_lightmap" in m["extensions"] for m in document["materials"])
    assert (out / "index.html").stat().st_size > 1000


# ``test_late_failures`` bakes such a light map, too.
@pytest.mark.slow
def test_a_light_that_moves(tmp_path):
    vary = ("light.position=box(-0.5,1.2,-0.5,0.5,1.6,0.5)",)
    bake(BakeSettings("cornell", tmp_path, vary=vary, **SMALL))
    fields, variables = read_fields(tmp_path / "scene.glb")
    assert [f.role for f in fields] == ["indirect"] and variables[0]["kind"] == "point"
    assert {"light", "uv1"} <= set(fields[0].graph.inputs)


def test_light_that_stands_still_and_light_that_moves_have_checkpoints_of_their_own(tmp_path):
    scene, room = load("cornell"), tmp_path / "room.glb"
    lamp = dataclasses.replace(scene.meshes[-1], emission=(8.0, 8.0, 8.0))
    write_plain(room, dataclasses.replace(scene, meshes=[*scene.meshes[:-1], lamp]))
    scene, vary = load(room), ("light.position=box(-0.5,1.2,-0.5,0.5,1.6,0.5)",)
    few = SMALL | {"preset": "report-relu", "vary": vary, "lights_per_shard": 1, "steps": 4}
    settings = BakeSettings(str(room), tmp_path / "out", **few)
    job = Job(scene, Request(**request_of(settings)), settings.options, Work(settings, scene.digest), QUIET)
    field = LightmapField()
    state = field.prepare(job)
    fits = {role: field.fit(state, role, field.sample(state, role)) for role in state.roles}
    inputs = {role: set(fit.lower().graph.inputs) for role, fit in fits.items()}
    assert "light" in inputs["indirect"] and "light" not in inputs["static"]


@pytest.mark.slow
def test_plain_has_no_network(tmp_path):
    report = bake(BakeSettings("cornell", tmp_path, preset="plain", **SMALL))
    assert report["macs_per_pixel"] == 0


def test_a_killed_bake_ends_with_the_same_bytes(tmp_path, monkeypatch, kept, whole):
    halved = tmp_path / "halved"
    get, calls = WorkPart.get, []

    def killed(self, function, *arguments):
        calls.append(function)
        if calls.count("lightmap.phase") == 2:
            raise KeyboardInterrupt
        return get(self, function, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(WorkPart, "get", killed)
        with pytest.raises(KeyboardInterrupt):
            bake(BakeSettings("cornell", halved, **SMALL))
    kept = {entry.function for entry in store_of(halved).entries()}
    assert {f"lightmap.{name}" for name in ("sides", "path-counts", "light", "views", "phase")} <= kept
    bake(BakeSettings("cornell", halved, resume=True, **SMALL))
    assert (halved / "scene.glb").read_bytes() == (whole[0] / "scene.glb").read_bytes()


def _light_of(out):
    """The stored light at the texels, if there is any."""
    return next((entry for entry in store_of(out).entries() if entry.function == "lightmap.light"), None)


@pytest.mark.slow
def test_a_bake_killed_by_the_system_ends_with_the_same_bytes(tmp_path):
    """kill -9 as soon as the light at the texels is kept; what was traced is not traced again."""
    program = (
        "import sys, pathlib; from lightwell.baking.pipeline import bake\n"
        "from lightwell.baking.settings import BakeSettings\n"
        "from lightwell.fields.budget import Budget\n"
        f"small = {SMALL}\n"
        "bake(BakeSettings('cornell', pathlib.Path(sys.argv[1]), resume='again' in sys.argv, keep=True, **small))\n"
    )
    command = [sys.executable, "-c", program]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run([*command, whole], check=True, capture_output=True, timeout=300)
    with subprocess.Popen([*command, killed], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        light, deadline = _light_of(killed), time.monotonic() + 300
        while light is None and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.01)
            light = _light_of(killed)
        os.kill(process.pid, signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL and not (killed / "scene.glb").exists()
    kept = light.path.stat().st_ino
    subprocess.run([*command, killed, "again"], check=True, capture_output=True, timeout=300)
    # Reading an entry sets its time; writing it again would be another file.
    assert light.path.stat().st_ino == kept
    assert (killed / "scene.glb").read_bytes() == (whole / "scene.glb").read_bytes()


def test_small_charts_get_a_larger_square():
    from lightwell.fields.lightmap import sides

    scene, _ = sides.lit_scene(load("cornell"))
    stored = sides.lit_sides(scene, 0)
    for least, largest, size in ((0.0, 2048, 64), (1.0, 2048, 128), (1.0, 64, 64)):
        assert roomy_atlas(scene, 64, 0, stored, AtlasLimits(least, largest)).first.size == size


@pytest.mark.parametrize(
    "preset",
    [
        "directional",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("default-int8", "report", "siren", "siren-two-stage")
        ),
    ],
)
def test_every_preset_becomes_pictures(sampled, tmp_path, preset, kept):
    graph = fitted(sampled, tmp_path, preset=preset, steps=10).lower().graph
    pictures = {name for name, buffer in graph.buffers.items() if buffer.type == "uint8"}
    assert (
        pictures
        == {
            "report": {"f0", "f1", "f2"},
            "siren": set(),
            "siren-two-stage": {"f0", "f1", "f2"},
            "directional": {"e", "d", "m"},
            "default-int8": {"e", "m", "f0", "f1", "f2"},
        }[preset]
    )


def test_a_fitted_siren_becomes_a_shadertoy(sampled, tmp_path):
    graph = fitted(sampled, tmp_path, preset="siren", steps=2).lower().graph
    (tmp_path / "siren.glb").write_bytes(glb_bytes(sampled[0].scene, [FieldEntry("light", "static", graph)], []))
    path = tmp_path / "siren.glsl"
    assert main(["export", str(tmp_path / "siren.glb"), "--to", "shadertoy", "-o", str(path)]) == 0
    text = path.read_text()
    assert "mainImage" in text and "uniform" not in text and "sin(" in text


# Each form of a preset with a network is trained for a trial.
@pytest.mark.parametrize(
    ("preset", "most"), [("directional", 1900), pytest.param("default", 4800, marks=pytest.mark.slow)]
)
def test_max_bytes_are_kept(sampled, tmp_path, preset, most):
    def size(folder: str, **options) -> int:
        lowered = fitted(sampled, tmp_path / folder, options=options, preset=preset).lower()
        weights = sum(buffer.nbytes for name, buffer in lowered.graph.buffers.items() if name not in lowered.pictures)
        return weights + sum(len(picture.data) for picture in lowered.pictures.values())

    assert size("few", max_bytes=most) <= most < size("all")


@pytest.mark.slow
def test_ktx2_pictures_and_a_page_without_a_decoder(tmp_path):
    options = {"size": 64, "mips": 0, "compress": "ktx2"}
    bake(BakeSettings("cornell", tmp_path, preset="plain", **SMALL | {"options": options}))
    glb = (tmp_path / "scene.glb").read_bytes()
    document, _ = unpack(glb)
    pictures = [image["mimeType"] for image in document["images"]]
    assert sorted(pictures) == ["image/jpeg", "image/ktx2", "image/ktx2"]
    assert {"KHR_texture_basisu", "MOZ_lightmap"} <= set(document["extensionsUsed"])
    shown, _ = unpack(without_ktx2(glb))
    assert "image/ktx2" not in str(shown) and "KHR_texture_basisu" not in str(shown)
    (tmp_path / "page.glb").write_bytes(without_ktx2(glb))
    own, page = (read_fields(tmp_path / name)[0][0].graph.buffers for name in ("scene.glb", "page.glb"))
    assert np.array_equal(own["e"].array, page["e"].array) and np.array_equal(own["m"].array, page["m"].array)
    carried = re.search(r'id="lightwell-asset">([^<]*)<', (tmp_path / "index.html").read_text())[1]
    assert gzip.decompress(base64.b64decode(carried)) == with_smaller_textures(without_ktx2(glb))


def test_too_few_bytes_are_refused(sampled, tmp_path):
    with pytest.raises(ValueError, match="--max-bytes 100 is too few for this light map, whose smallest form takes"):
        fitted(sampled, tmp_path, preset="plain", options={"max_bytes": 100})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--preset", "nonsense"], "no preset 'nonsense'; choose one of default, report"),
        (["--max-bytes", "many"], "--max-bytes 'many' is not a size; write 1MB, 250kB"),
        (["--size", "1000"], "--size 1000 is not a power of two"),
        (["--mips", "-1"], "--mips -1 is too small"),
        (["--compress", "ktx2", "--max-bytes", "1MB"], "--max-bytes chooses among WebP pictures"),
    ],
)
def test_mistakes_are_one_line(tmp_path, capsys, arguments, words):
    code = main(["bake", "cornell", "-o", str(tmp_path), "--field", "lightmap", *arguments])
    text = capsys.readouterr().err
    assert code == 2 and words in text and text.count("\n") == 1


def test_the_best_of_several_starts_is_taken():
    """By samples that training never saw; too few steps for two starts are one."""
    from lightwell.fields.lightmap import sides, trace, views

    scene, _ = sides.lit_scene(load("cornell"))
    made = trace.chart(scene, 64, 0, 4, 0)
    eyes = views.eye_samples(scene, made, 1 << 12, 4, 5, made.image)
    errors = {0: 0.3, fitting.START_SEED: 0.1, 2 * fitting.START_SEED: 0.2}
    seen = []

    def error(fit, samples):
        seen.append((fit.seed, bool(fit.preset.hidden), len(samples.weight)))
        return errors[fit.seed] if fit.preset.hidden else 1.0

    starts = fitting.Starts(enough_steps=10, held=400, error=error)
    best = fitting.fitted(scene, made, eyes, PRESETS["default"], 0, 30, starts=starts)
    assert best.seed == fitting.START_SEED and best.history[-1][0] == 10
    assert [s[1] for s in seen] == [True, True, True, False] and 200 < seen[0][2] < 600
    seen.clear()
    assert fitting.fitted(scene, made, eyes, PRESETS["default"], 0, 19, starts=starts).seed == 0 and len(seen) == 2


@pytest.mark.parametrize(("fewest", "size"), [(0, 128), pytest.param(100_000, 64, marks=pytest.mark.slow)])
def test_a_larger_square_needs_the_paths_for_it(tmp_path, fewest, size):
    """What small charts gain by larger texels' noise they lose: the square stays as it is where paths are few."""
    presets = {"plain": dataclasses.replace(PRESETS["plain"], size=64)}
    field = LightmapField(presets, AtlasLimits(least_coverage=1.0, largest=128, fewest_paths=fewest, usable=0.0))
    changes = {"options": {"mips": 0}, "steps": 10, "shards": None, "budget": Budget(0.1)}
    state, samples = lit(field, BakeSettings("cornell", tmp_path, preset="plain", **SMALL | changes))
    planned, _, _, smaller = state.job.work.part(field="lightmap").find("lightmap.path-counts", JSON)
    assert (state.atlas.size, state.paths, smaller) == (size, planned, size == 64)
    fit = field.fit(state, "static", samples)
    assert fit.plan["texel_paths"] == state.paths and fit.chart.atlas.size == size
    assert fit.lower().graph.buffers["e"].shape[:2] == (size, size)


def test_an_error_budget_takes_rounds_and_says_what_was_reached(sampled, tmp_path):
    """As for every field: each round has twice the paths, eye samples and steps of the last."""
    said = []

    class Heard(Progress):
        def say(self, text):
            said.append(text)

    fit = fitted(sampled, tmp_path, Heard(quiet=True), budget=Budget(None, 1e-6, rounds=1), steps=10)
    plan, first = fit.plan, sampled[0]
    assert (plan["steps"], plan["eye_samples"], plan["texel_paths"]) == (20, 2 * first.eyes, 2 * first.paths)
    assert any("after 2 rounds, asked for" in text for text in said)
