"""Light maps in KTX2 pictures: training sees the error of the codec, so that what ships is about as good as WebP."""

from dataclasses import replace

import numpy as np
import pytest
from test_lightmap_field import RNG as QUERIES
from test_lightmap_field import SIZE, START, lobes, queries, radiance, ramp

from lightwell.fields.base import FieldSetup
from lightwell.fields.lightmap.curve import stored
from lightwell.fields.lightmap.fit import PRESETS, LightmapFit, LightmapPreset
from lightwell.fields.lightmap.options import stored_as
from lightwell.fields.lightmap.stored_features import codec_error, feature_pictures, read_back
from lightwell.graph.pictures import encode, gpu_bytes
from lightwell.networks.atlas_texture import AtlasTexture
from lightwell.networks.lightmap import LightmapNetwork

WEBP = LightmapPreset("png", channels=6, share=0.5, hidden=(16, 16), inputs="mirror", surface=(32, 32))
STEPS = 300


def fitted(preset: LightmapPreset) -> LightmapFit:
    QUERIES.bit_generator.state = START
    query = queries(1 << 12)
    setup = FieldSetup((0.5, 0.5, 0.5), 0.5, 2.0, "static", (1.0, 1.0, 1.0))
    fit = LightmapFit(preset, SIZE, 2.0, encode(stored(ramp()), preset.base), batch=1 << 10, setup=setup)
    fit.train(query, lobes(query), np.ones(len(query), np.float32), STEPS)
    return fit


@pytest.fixture(scope="module")
def fits():
    """The same light map with features as WebP and as blocks."""
    return {codec: fitted(replace(WEBP, codec=codec)) for codec in ("webp", "uastc")}


def error(light: np.ndarray, query) -> float:
    return float(np.sqrt(np.mean((light - lobes(query)) ** 2)) / lobes(query).mean())


def test_blocks_lose_little_because_training_sees_them(fits):
    fresh = queries(2048)
    found = {codec: error(radiance(fit, fresh), fresh) for codec, fit in fits.items()}
    # 0.5 dB.
    assert found["uastc"] < 1.06 * found["webp"]


def test_training_reads_what_a_viewer_will_read():
    """Rounded features and the error of their codec are the decoded features, whatever layers made them."""
    texture = AtlasTexture(8, 8, 4, "round")
    network = LightmapNetwork(texture, 3, inputs=1, error=AtlasTexture(8, 8, 4, "frozen"))
    parameters = network.initial(1)
    parameters["t0"] = np.random.default_rng(2).random((64, 4)).astype(np.float32)
    rows = np.random.default_rng(3).random((256, 12)).astype(np.float32)
    decoded = read_back(feature_pictures(parameters["t0"], texture, 3, "etc1s"), texture, 3)
    viewer = replace(network, error=None, texture=replace(texture, quantiser="frozen"))
    expected = viewer.evaluate(parameters | {"t0": decoded}, rows)
    error = codec_error(parameters["t0"], texture, 3, "etc1s")
    off = lambda e0: np.abs(network.evaluate(parameters | {"e0": e0}, rows) - expected).max()  # noqa: E731
    assert off(error) < 1e-4
    # Planted: no error, and one of other texels.
    assert off(0 * error) > 1e-2 and off(error[::-1]) > 1e-2


def test_the_network_is_fitted_to_the_decoded_features(fits):
    fit = fits["uastc"]
    assert {picture.mime for picture in fit.features.values()} == {"image/ktx2"}
    decoded = np.concatenate([fit.features[name].texels for name in ("f0", "f1")], axis=2).reshape(-1, 6)
    assert np.array_equal(np.floor(255 * fit.parameters["t0"][:, :6] + 0.5), decoded)
    assert "e0" not in fit.parameters
    query = queries(512)
    assert np.abs(radiance(fit, query) - fit.predict(query)).max() < 5e-3 * fit.unit


def test_the_error_of_a_codec_is_what_is_read_back_less_what_was_meant():
    texture = AtlasTexture(8, 8, 8)
    values = np.random.default_rng(1).random((64, 8)).astype(np.float32)
    values[:, 5:] = 0
    rounded = np.floor(values * 255 + 0.5) / 255
    found = codec_error(values, texture, 5, "uastc")
    expected = read_back(feature_pictures(values, texture, 5, "uastc"), texture, 5) - rounded
    assert np.abs(found - expected).max() < 1e-6 and np.abs(found[:, :5]).max() > 0.01
    # A lossless codec has none, and rows in another order have another one.
    assert np.abs(codec_error(values, texture, 5, "webp")).max() < 1e-6
    assert np.abs(codec_error(values[::-1], texture, 5, "uastc") - expected).max() > 0.01


def test_far_away_the_stored_levels_are_read():
    texels = np.repeat(np.repeat(stored(ramp()), 2, axis=0), 2, axis=1)
    picture = encode(texels, "uastc", mips=1)
    far = picture.buffer(1).array.astype(float)
    assert far.shape == (SIZE, SIZE, 3) and np.abs(far - stored(ramp())).mean() < 2
    # Not the means of level 0 after its own error.
    assert not np.array_equal(far, encode(picture.texels, "png").buffer(1).array)


def test_the_option_chooses_the_codecs():
    default = PRESETS["default"]
    assert stored_as(default, None) is default
    assert stored_as(default, "ktx2") == replace(default, base="uastc", codec="uastc")
    assert stored_as(default, "ktx2-etc1s") == replace(default, base="etc1s", codec="uastc")
    assert stored_as(PRESETS["report"], "ktx2").base == ""


def test_memory_on_the_gpu_is_a_quarter():
    texels = np.zeros((32, 32, 3), np.uint8)
    webp, uastc, etc1s = (gpu_bytes(encode(texels, codec)) for codec in ("webp", "uastc", "etc1s"))
    assert (webp, uastc, etc1s) == (4096, 1024, 512)
    # A GPU makes every level of a picture that may be minified; a file of blocks has those that may be read.
    assert gpu_bytes(encode(texels, "webp", 1)) == 4096 + 1024 + 256 + 64 + 16 + 4
    assert gpu_bytes(encode(texels, "uastc", 1)) == 1024 + 256
