"""Encodings, permutation, average, scale, tiles, settings: each against its formula."""

import math

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.cache import encodings
from lightwell.cache.batches import compacted, permuted
from lightwell.cache.brightness_correction import RadianceScaling
from lightwell.cache.features import Vertex, paper_inputs, raw_inputs
from lightwell.cache.learner import Learner, averaging, believed, loss
from lightwell.cache.model import Model
from lightwell.cache.scale import RadianceScale
from lightwell.cache.settings import CacheSettings, NetworkSettings, settings_of
from lightwell.cache.tiles import Tiles


def test_triangle_wave_is_the_formula():
    x = np.random.default_rng(0).random(64)
    got = np.array([np.array(w) for w in encodings.triangle_wave(mi.Float(x))])
    octave = np.arange(12)[:, None]
    v = x * 2.0 ** (octave - 1) + octave / 4
    assert np.abs(got - (4 * np.abs(v - np.floor(v) - 0.5) - 1)).max() < 2e-3  # octave 11 has slope 4096


def test_one_blobs_add_up_to_one_and_wrap():
    x = mi.Float(np.linspace(0, 1, 33))
    for periodic in (False, True):
        assert np.allclose(sum(np.array(b) for b in encodings.one_blob(x, 4, periodic)), 1, atol=1e-6)
    ends = np.array([np.array(b) for b in encodings.one_blob(mi.Float([0.0, 1.0]), 4, True)])
    assert np.allclose(ends[:, 0], ends[:, 1], atol=1e-6)


def test_inputs_have_the_paper_s_count_and_end_in_ones():
    v = Vertex(mi.Point3f(0.1, 0.2, 0.3), r=0.5)
    assert len(paper_inputs(v)) == 64 and [float(x[0]) for x in paper_inputs(v)[-2:]] == [1, 1]
    assert len(raw_inputs(v)) == 16


@pytest.mark.parametrize("count", [1, 7, 4095, 65_535, 65_537])
def test_the_permutation_meets_every_record_once(count):
    bits = max(1, (count - 1).bit_length())
    lane = dr.arange(mi.UInt32, count)
    got = np.array(permuted(lane, dr.opaque(mi.UInt32, count), bits, dr.opaque(mi.UInt32, 3)))
    assert np.array_equal(np.sort(got), np.arange(count))
    if count > 7:
        assert (got != np.arange(count)).mean() > 0.9


def test_compaction_keeps_the_order():
    rows, count = compacted(mi.Bool([False, True, True, False, True]))
    assert int(count[0]) == 3 and list(np.array(rows)[:3]) == [1, 2, 4]


def test_the_average_of_constant_weights_is_the_weights_and_the_misprint_is_not():
    kept, wrong = 0.0, 0.0
    for t in range(1, 2000):
        new, old = averaging(0.99, t)
        kept = new + old * kept
        wrong = 0.01 / (1 - 0.99**t) + 0.99 * (1 - 0.99 ** (t - 1)) * wrong
        assert abs(kept - 1) < 1e-9
        if t == 64:
            assert wrong < 0.1  # the printed form has collapsed to 4 %


def test_the_loss_gradient_stops_at_the_denominator():
    output, target = np.array([[0.5, 0.2, 0.1]], np.float32), np.array([[1.0, 0.1, 0.4]], np.float32)
    f = mi.TensorXf(output)
    dr.enable_grad(f)
    dr.backward(loss(f, mi.TensorXf(target), mi.TensorXf(np.ones((1, 3), np.float32))))
    lum = output[0] @ [0.299, 0.587, 0.114]
    assert np.allclose(np.array(dr.grad(f)), 2 * (output - target) / (lum**2 + 0.01), rtol=1e-5)


@pytest.mark.parametrize("preset", ["compact", "paper"])
def test_inference_is_the_training_forward(preset):
    model = Model(settings_of({"preset": preset}).network)
    rng = np.random.default_rng(1)
    values = {k: mi.TensorXf((rng.normal(size=v.shape) * 0.3).astype(np.float32)) for k, v in model.initial(0).items()}
    n = 50
    unit = lambda: mi.Vector3f((lambda a: a / np.linalg.norm(a, axis=0))(rng.normal(size=(3, n))))  # noqa: E731
    v = Vertex(mi.Point3f(rng.random((3, n))), unit(), unit(), mi.Float(rng.random(n)), mi.Color3f(rng.random((3, n))),
               mi.Color3f(rng.random((3, n))))  # fmt: skip
    packed = model.packed(values)
    inside = np.array(model.evaluate(packed, v)).T
    direct = mi.TensorXf(np.stack([np.array(x) + np.zeros(n) for x in model.inputs(v)], 1).astype(np.float32))
    points = mi.TensorXf(np.array(v.p).T.astype(np.float32).copy())
    assert np.allclose(inside, np.array(model.forward(values, direct, points)), atol=1e-4)
    if preset == "paper":
        x = np.array(direct)
        for k in range(6):
            x = x @ np.array(values[f"w{k}"])
            x = np.maximum(x, 0) if k < 5 else x
        assert np.allclose(inside, x, atol=1e-3)
        assert model.parameters == 64 * 64 * 5 + 64 * 3


def test_a_change_of_scale_changes_no_radiance():
    settings = CacheSettings(network=NetworkSettings(entries_log2=8, levels=2))
    learner = Learner(Model(settings.network), settings.training, settings.seed)
    v = Vertex(mi.Point3f([0.2, 0.4], [0.1, 0.9], [0.5, 0.5]), a=mi.Color3f(0.5))
    before = np.array(learner.model.radiance(learner.model.packed(learner.values), v, RadianceScaling(mi.Float(1))))
    learner.rescale(8.0)
    after = np.array(learner.model.radiance(learner.model.packed(learner.values), v, RadianceScaling(mi.Float(1 / 8))))
    assert np.allclose(before, after, rtol=1e-5)
    learner.keep()
    learner.rescale(4.0)
    assert learner.restore()
    unscale = RadianceScaling(mi.Float(1 / 32))
    restored = np.array(learner.model.radiance(learner.model.packed(learner.values), v, unscale))
    assert np.allclose(before, restored, rtol=1e-5)


def test_the_scale_waits_eight_frames_and_is_a_power_of_two():
    scale = RadianceScale()
    assert scale.update(np.full(1000, 0.01)) == 128 and scale.value == 128
    changes = [scale.update(np.full(1000, 100.0)) for _ in range(30)]
    assert sum(c != 1 for c in changes[:7]) == 0 and scale.value in (2.0**-6, 2.0**-7)
    assert RadianceScale(3.0).update(np.full(10, 100.0)) == 1


@pytest.mark.parametrize("size", [(1920, 1080), (256, 256), (64, 48)])
def test_the_tiles_reach_their_target(size):
    tiles, rng = Tiles(65_536 if size[0] > 1000 else 16_384, 0.03), np.random.default_rng(0)
    for _ in range(30):
        columns, rows, _, _ = tiles.grid(*size)
        records = int(columns * rows * 2.7 * rng.uniform(0.98, 1.02))
        tiles.update(records, columns * rows, *size)
    # A small picture has few tiles: rounding their number is worth more than five per cent there.
    assert abs(records / tiles.wanted(*size) - 1) < (0.05 if size[0] > 100 else 0.2)


def test_settings_say_what_is_wrong():
    with pytest.raises(ValueError, match="there is no parameter 'foo'"):
        settings_of({"foo": 1})
    with pytest.raises(ValueError, match=r"'terminaton_c'; did you mean .*termination_c") as stats:
        settings_of({"terminaton_c": 1})
    assert len(str(stats.value)) < 160 and "docs/radiance-cache.md lists them" in str(stats.value)
    with pytest.raises(ValueError, match="expected one of compact, paper"):
        settings_of({"preset": "big"})
    with pytest.raises(ValueError, match="max_depth = 0"):
        settings_of({"max_depth": 0})
    with pytest.raises(ValueError, match="seed = -1"):
        settings_of({"seed": -1})
    with pytest.raises(ValueError, match="tail_attenuation = 2"):
        settings_of({"tail_attenuation": 2.0})
    shipped = settings_of({})  # what the ladder's last rungs take away one at a time
    assert shipped.image.local_level and shipped.image.spike_cap > 0
    assert shipped.guiding.guide == "auto" and shipped.estimation.first_hit == "nee"
    assert settings_of({"termination_sdk_t": 0.1}).paths.termination_c == pytest.approx(1.579, abs=1e-3)
    assert settings_of({"preset": "paper"}).network.layers == 5
    assert math.isinf(settings_of({"termination_c": "inf"}).paths.termination_c)


def test_the_early_average_forgets_the_first_steps_and_becomes_the_plain_one():
    plain, early = 1.0, 1.0
    for t in range(1, 2000):
        value = 1.0 if t <= 10 else 0.0
        for name, g in (("plain", 0.0), ("early", 8.0)):
            new, old = averaging(0.99, t, g)
            assert new + old == 1 and (t > 1 or new == 1)
            if name == "plain":
                plain = new * value + old * plain
            else:
                early = new * value + old * early
        if t == 40:
            assert plain > 0.2 and early < 1e-3
    assert averaging(0.99, 5000, 8.0) == averaging(0.99, 5000)


def test_records_are_believed_up_to_a_multiple_of_what_the_network_says():
    output = mi.TensorXf(np.array([[1, 1, 1], [0, 0, 0], [-5, 0, 0]], np.float32))
    target = np.array([[100, 100, 100], [20, 40, 20], [2, 1, 0]], np.float32)
    out = np.array(believed(output, mi.TensorXf(target), 10.0))
    lum = np.array([0.299, 0.587, 0.114])
    assert np.allclose(out[0], 20) and np.allclose(out[1], target[1] * 10 / (target[1] @ lum), rtol=1e-5)
    assert np.allclose(out[2], target[2]) and np.array(believed(output, mi.TensorXf(target), 0.0))[0, 0] == 100
