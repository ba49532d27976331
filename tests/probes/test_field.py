"""The field: its graph means its prediction, its files hold its light, and light adds."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from leak_scenes import two_rooms

from lightwell.asset.records import FieldEntry
from lightwell.asset.write import write_glb
from lightwell.cli import main
from lightwell.core.formats import COMPRESSED
from lightwell.core.progress import Progress
from lightwell.core.store import Store
from lightwell.core.work import store_of
from lightwell.fields.base import FieldSetup
from lightwell.fields.features import open_builder
from lightwell.fields.probes.baked import BakedProbes, state_key
from lightwell.fields.probes.fit import PRESETS, ProbesFit, fit_of, solved
from lightwell.fields.probes.options import ProbesOptions, parse_box
from lightwell.fields.probes.rebake import RebakeState
from lightwell.fields.protocol import Job, Shown
from lightwell.fields.request import Request
from lightwell.graph import evaluate
from lightwell.probes import generator
from lightwell.probes.bake import bake_geometry
from lightwell.probes.file import decode_volume, encode_volume, read, read_baselines
from lightwell.probes.samples import ProbeSampling
from lightwell.probes.volume import query
from lightwell.scenes import load
from lightwell.scenes.variables import declare, to_json

TINY = replace(
    PRESETS["draft"],
    places=6,
    rank=3,
    gathered_sampling=ProbeSampling(4, 64, 64),
    static_sampling=ProbeSampling(4, 16, 16),
    bricks=0.5,
)


def tiny_fit(scene, variable, preset) -> ProbesFit:
    """Probes a metre apart, not trained."""
    setup = FieldSetup.of(scene, 1.0, variable.kind, variable)
    return ProbesFit(setup, preset, 3, solved(setup, preset, 3, 1.0))


def written(fit: ProbesFit, out, light) -> str:
    """Write the files of a fit; returns its note."""
    (out / "scene.glb").write_bytes(b"glTF")
    for file in fit.files(out / "scene.glb", Shown(np.asarray(light, float), np.ones(3))):
        file.write(out / file.name)
    return fit.note


@pytest.fixture(scope="module")
def moving():
    scene = load("two-rooms")
    variable = declare((), scene)
    return tiny_fit(scene, variable, TINY)


def places(count: int = 400):
    rng = np.random.default_rng(0)
    n = rng.standard_normal((count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    x = rng.uniform([-2.5, 0.3, -1.5], [2.5, 2.2, 1.5], (count, 3))
    return x.astype(np.float32), n.astype(np.float32)


def test_the_graph_means_the_volume_under_any_light(moving):
    x, n = places()
    for light in ([-1.5, 1.5, 0.2], [1.4, 1.0, -0.5]):
        volume = moving.volume(np.array(light), 1.0)
        expected = query(volume, x, n)[0] / np.pi
        inputs = {"position": x, "normal": n, "light": np.tile(np.float32(light), (len(x), 1))}
        found = evaluate(moving.lower(), inputs)["radiance"]
        assert np.abs(found - expected).max() < 0.03 * np.abs(volume.light[:, 0]).max()


def test_light_adds_and_scales(moving):
    a, b = (moving.volume(np.array(p), 1.0) for p in ([-1.5, 1.5, 0.2], [1.4, 1.0, -0.5]))
    assert np.array_equal(a.params, b.params) and np.array_equal(a.state, b.state)
    twice = moving.volume(np.array([-1.5, 1.5, 0.2]), np.array([2.0, 0.5, 0.0]))
    assert np.allclose(twice.light, a.light * [2.0, 0.5, 0.0], atol=1e-6)


def test_a_bake_writes_the_volume_and_its_page(moving, tmp_path):
    light = np.array([-1.5, 1.5, 0.2])
    written(moving, tmp_path, light)
    found, volume = read(tmp_path / "probes-indirect.lwp"), moving.volume(light, 1.0)
    assert (tmp_path / "probes.html").stat().st_size > 1e5
    assert np.array_equal(found.state, volume.state) and moving.facts["file_bytes_per_probe"]["light"] >= 20
    assert np.allclose(found.light[:, 0], volume.light[:, 0], rtol=2e-3, atol=1e-3 * np.abs(volume.light).max())


def test_the_report_tells_of_the_baselines(moving):
    told = moving.facts["baselines"]
    assert set(told) == {"learned", "trilinear", "trilinear + validity", "DDGI", "line of sight"}
    assert told["learned"]["smape"] < told["trilinear"]["smape"]
    assert all(0 <= value <= 1 for row in told.values() for value in row.values())


def test_the_payload_is_told(moving, tmp_path):
    told = written(moving, tmp_path, [-1.5, 1.5, 0.2])
    assert "payload 84 B a record" in told and "1296 B" in told and "\n" not in told
    assert moving.facts["bytes_per_probe"]["record"] == 84 and moving.facts["bytes_of_distance_moments"] == 1296


def test_a_file_beside_it_holds_the_baselines(moving, tmp_path):
    written(moving, tmp_path, [-1.5, 1.5, 0.2])
    assert read_baselines(tmp_path / "probes-indirect.lwp") is None
    moments = read_baselines(tmp_path / "probes-indirect-compare.lwp")
    assert moments.light.max() > 0 and moments.alive.any() and moments.maps[moments.alive].max() > 0


@pytest.mark.parametrize(
    "name",
    [
        "mlp-generated",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("mlp", "product-field", "bare-relu-field-5")),
    ],
)
def test_every_weight_function_can_be_baked(name):
    preset, (x, n) = PRESETS[name], places(200)
    volume = bake_geometry(load("two-rooms"), 1.5, preset.function, fit=fit_of(preset)).volume
    assert volume.function == preset.function and len(volume.params)
    z = query(volume, x, n)[1]
    assert 0.5 < np.median(z) <= 1 + 1e-5
    found = decode_volume(encode_volume(volume, "zh3")[0])
    assert found.function == preset.function and np.abs(query(found, x, n)[1] - z).max() < 1e-4


def test_without_a_generator_a_bake_fits_directly(tmp_path):
    assert generator.load(tmp_path / "missing.npz") is None
    other = replace(generator.load(), networks={})
    assert generator.fit_with(PRESETS["mlp"].function, other) is None
    assert fit_of(replace(PRESETS["mlp"], generator=False)) is None


# ---------------------------------------------------------------------- incremental


def answers(made: BakedProbes) -> np.ndarray:
    x, n = places(300)
    light = np.tile(np.float32([-1.5, 1.5, 0.2]), (len(x), 1))
    return evaluate(made.lower(), {"position": x, "normal": n, "light": light})["radiance"]


def test_an_edit_of_nothing_keeps_every_byte(moving, tmp_path):
    shown = Shown(np.array([-1.5, 1.5, 0.2]), np.ones(3))
    store = Store(tmp_path)
    store.put(state_key("indirect"), moving.baked.arrays(shown), COMPRESSED)
    before, found = BakedProbes.of(store.find(state_key("indirect"), COMPRESSED))
    assert np.array_equal(found.light, shown.light)
    box = np.array([[-0.4, 0.0, -0.4], [0.4, 1.0, 0.4]])
    after, again = before.rebaked(moving.setup.scene, moving.setup.variable, box, None)
    assert not len(again)
    for made in (before, after):
        assert np.array_equal(made.basis, moving.baked.basis)
        assert np.array_equal(answers(made), answers(moving.baked))


@pytest.mark.slow
def test_an_edit_changes_what_it_touches_alone():
    scene, shut = two_rooms(0.05, door=True).scene, two_rooms(0.05, door=True, shut=True).scene
    variable = declare(("light.position=box(-2,0.5,0.5,-1,2,2.5)",), scene)
    first = tiny_fit(scene, variable, replace(TINY, places=4, rank=2))
    box = np.array([[-0.03, 0, 0.95], [0.03, 2.05, 1.95]])
    after, again = first.baked.rebaked(shut, variable, box, None)
    basis, was = after.basis, first.baked.basis
    held = np.setdiff1d(np.arange(len(basis)), again)
    assert 0 < len(again) < len(basis) and np.array_equal(basis[held], was[held])
    assert (basis[again] != was[again]).any()
    # The weights are those of a whole bake.
    whole = bake_geometry(shut, 1.0, "relu-field", lattice=after.lit.geometry.volume.lattice)
    count = len(whole.volume.lattice)
    assert np.array_equal(whole.volume.state, after.lit.geometry.volume.state[:count])
    assert np.array_equal(whole.records[0].params, after.lit.geometry.records[0].params)


def test_states_of_strangers_are_refused(moving):
    good = moving.baked.arrays(Shown(np.zeros(3), np.ones(3)))
    head = json.loads(good["head"].tobytes())
    changes = {
        "0.slot": good["0.slot"][::-1],
        "0.near": good["0.near"] * np.float32(np.nan),
        "0.nodes": good["0.nodes"] + 10**6,
        "0.source": good["0.source"] + 10**6,
        "0.params": good["0.params"][:-1],
        "fallback": good["fallback"] + 10**6,
        "start": good["start"][:, :-1],
        "rows.cell": good["rows.cell"] + 10**6,
        "more.mix": good["more.mix"][:-1],
        "more.spline.weights": good["more.spline.weights"][:, :-1],
        "head": np.frombuffer(json.dumps(head | {"function": "wavelet"}).encode(), np.uint8),
        "number": None,
    }
    for name, value in changes.items():
        with pytest.raises(ValueError, match="not the state of light probes") as error:
            BakedProbes.of({k: v for k, v in (good | {name: value}).items() if v is not None})
        assert "\n" not in str(error.value), name


def test_a_folder_without_probes_is_refused(tmp_path, capsys):
    given = ["--field", "probes", "--rebake", str(tmp_path), "--box=-1,0,-1,1,1,1"]
    assert main(["bake", "two-rooms", "-o", str(tmp_path / "out"), *given]) == 2
    text = capsys.readouterr().err
    assert "holds no probes of this version of lightwell" in text and text.count("\n") == 1


def test_an_edit_is_lit_by_the_light_of_the_earlier_bake(moving, tmp_path):
    """The probes hold its places: those of a sun would be taken for places of a lamp."""
    sun, scene = declare(("sun.direction=arc(90,10,270,10)",), moving.setup.scene), moving.setup.scene
    b = open_builder()
    entry = FieldEntry("indirect", "indirect", b.build(radiance=b.scale("reflectance", 0.0)), 0)
    write_glb(tmp_path / "scene.glb", scene, [entry], [to_json(sun)])
    arrays = moving.baked.arrays(Shown(np.zeros(3), np.ones(3)))
    store_of(tmp_path).put(state_key("indirect"), arrays, COMPRESSED)

    def light(*vary: str):
        options, work = ProbesOptions(rebake=tmp_path, box=(0, 0, 0, 1, 1, 1)), SimpleNamespace()
        return RebakeState.of(Job(scene, Request(vary=vary), options, work, Progress(quiet=True))).variable

    assert light().kind == "sun" and light("sun.direction=arc(90,10,270,10)").kind == "sun"
    for other in ("sun.direction=arc(90,20,270,20)", "light.radius=0.1"):
        with pytest.raises(ValueError, match="was baked with another light; repeat its --vary, or leave --vary out"):
            light(other)


@pytest.mark.parametrize("text", ["", "0,0,0", "0,0,0,1,1,nan", "1,0,0,0,1,1", "a,b,c,d,e,f"])
def test_a_box_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="smallest corner first"):
        parse_box(text)
