"""The generator: what it ships, what it refuses, and that a start is all it gives."""

import numpy as np
import pytest
from leak_scenes import two_rooms

from lightwell.graph.ops.activate import LEAK
from lightwell.probes.bake import bake_geometry
from lightwell.probes.generator import FILE, Generator, fit_with, load, run
from lightwell.probes.page import PLACE, write_page
from lightwell.probes.pattern import pattern
from lightwell.probes.support import cube_valid
from lightwell.probes.volume import WEIGHTED
from lightwell.probes.weights import FUNCTIONS, error, point_weight, trusted


@pytest.fixture(scope="module")
def cubes():
    made = bake_geometry(two_rooms(0.1, door=True).scene, 1.0, "relu-field", (0.3, 0.1, 0.7))
    rows = np.flatnonzero(made.records[0].state == WEIGHTED)[:12]
    target, valid = made.target[rows].astype(np.float32), cube_valid(made.support, rows)
    return target, valid, point_weight(target, pattern().hat, valid)


def test_it_is_small_and_knows_two_functions():
    generator = load()
    assert FILE.stat().st_size < 2e6 and set(generator.networks) == {"mlp", "relu-field"}


@pytest.mark.parametrize("function", ["mlp", "relu-field"])
def test_a_start_and_a_few_steps_beat_trilinear_weights(cubes, function):
    target, valid, weight = cubes
    f, layout = FUNCTIONS[function], pattern()
    found = fit_with(function)(target, weight, layout)
    rmse = lambda rho: error(target, rho, layout.hat, valid).mean()  # noqa: E731
    assert rmse(trusted(f.values(f.quantised(found), layout.u)[0])) < 0.5 * rmse(np.ones_like(target))


def test_a_pattern_it_does_not_know_is_fitted_directly(cubes):
    layout = pattern(128)
    target = np.ones((2, len(layout.u)), np.float32)
    found = fit_with("relu-field")(target, target, layout)
    assert np.allclose(found, FUNCTIONS["relu-field"].fit(target, target, layout))
    assert fit_with("product-field") is None


def test_without_a_file_there_is_no_generator(tmp_path):
    assert load(tmp_path / "none.npz") is None


def test_files_of_strangers_are_refused(tmp_path):
    good, path = load(), tmp_path / "g.npz"
    layers = good.networks["mlp"]
    bad = {
        "short": Generator(good.mean[:-1], good.components, good.networks),
        "wide": Generator(good.mean, good.components, {"mlp": [*layers[:-2], layers[-2][:, :-1], layers[-1][:-1]]}),
        "torn": Generator(good.mean, good.components, {"mlp": layers[:-1]}),
        "unknown": Generator(good.mean, good.components, {"wavelet": layers}),
        "infinite": Generator(good.mean + np.inf, good.components, good.networks),
    }
    for made in bad.values():
        made.save(path)
        with pytest.raises(ValueError, match="not a probe generator"):
            load(path)
    path.write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(ValueError, match="not a probe generator"):
        load(path)
    np.savez(path, mean=np.array([{}], object), allow_pickle=True)
    with pytest.raises(ValueError, match="not a probe generator"):
        load(path)


def test_the_network_is_its_formula():
    rng = np.random.default_rng(0)
    layers = [rng.normal(size=s) for s in ((3, 4), (4,), (4, 4), (4,), (4, 2), (2,))]
    x = rng.normal(size=(5, 3))
    leaky = lambda z: np.where(z > 0, z, LEAK * z)  # noqa: E731
    h = leaky(x @ layers[0] + layers[1])
    h = h + leaky(h @ layers[2] + layers[3])
    assert np.allclose(run(layers, x)[0], h @ layers[4] + layers[5], atol=1e-6)


def test_the_page_holds_the_volume_and_the_scene(tmp_path):
    write_page(tmp_path / "p.html", b"volume", b"scene")
    text = (tmp_path / "p.html").read_text()
    assert PLACE not in text and "dm9sdW1l" in text and "c2NlbmU=" in text
    assert 'href="index.html"' in text and 'href="report.html"' in text
    with pytest.raises(RuntimeError, match="must contain"):
        write_page(tmp_path / "p.html", b"", b"", shell="<html></html>")
