"""KTX2 pictures: what is encoded comes back, the same bytes each time; broken files are refused."""

import hashlib
import re
import subprocess
import sys

import numpy as np
import pytest

from lightwell import basisu
from lightwell.basisu import codec


def picture(edge: int = 16) -> np.ndarray:
    """Three smooth channels that differ."""
    y, x = np.mgrid[0:edge, 0:edge] / edge
    channels = [0.3 + 0.2 * x, 0.6 - 0.3 * y, 0.5 + 0.1 * np.sin(6 * x * y)]
    return np.floor(255 * np.stack(channels, axis=-1) + 0.5).astype(np.uint8)


def decibels(found: np.ndarray, expected: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean((found.astype(float) - expected) ** 2)))


# UASTC of photographs: 47 dB; ETC1S has one line of colours for a block.
@pytest.mark.parametrize(("name", "least"), [("uastc", 38), ("etc1s", 22)])
def test_what_is_encoded_comes_back(name, least):
    data = basisu.encode(picture(), name)
    assert basisu.is_ktx2(data) and basisu.size(data) == (16, 16)
    found = basisu.decode(data)
    assert found.shape == (16, 16, 3)
    assert decibels(found, picture()) > least
    # A picture that is turned over is found.
    assert decibels(found[::-1], picture()) < decibels(found, picture()) - 2
    assert basisu.encode(picture(), name) == data


def test_levels_are_means_of_four_texels():
    texels = np.repeat(np.repeat(picture(8), 2, axis=0), 2, axis=1)
    data = basisu.encode(texels, "uastc", mips=2)
    assert decibels(basisu.decode(data, 1), picture(8)) > 34
    assert basisu.decode(data, 2).shape == (4, 4, 3)
    with pytest.raises(ValueError, match="3 mip levels, and level 3 is read"):
        basisu.decode(data, 3)


def test_blocks_of_one_value_are_exact():
    for value in (0, 255):
        assert (basisu.decode(basisu.encode(np.full((8, 8, 3), value, np.uint8), "uastc")) == value).all()


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (lambda data: data[:40], "expected a header of 80"),
        (lambda data: data[:200], "KTX2: it"),
        (lambda data: data[:44] + b"\xff" * 8 + data[52:], "KTX2: it"),
        (lambda data: data[:-60] + b"\xff" * 60, "KTX2: it"),
    ],
)
def test_broken_files_are_refused_in_one_line(broken, words):
    with pytest.raises(ValueError) as caught:
        basisu.decode(broken(basisu.encode(picture(), "uastc")))
    assert words in str(caught.value) and "\n" not in str(caught.value)
    # The next file is read.
    assert basisu.decode(basisu.encode(picture(), "uastc")).shape == (16, 16, 3)


def test_edges_are_whole_blocks():
    with pytest.raises(ValueError, match="10 x 12 texels, expected multiples of 4"):
        basisu.encode(np.zeros((12, 10, 3), np.uint8), "uastc")


def test_the_encoder_is_the_one_that_the_notice_names():
    wasm = codec.stored("basis_encoder.wasm")
    notice = (codec.files("lightwell.basisu") / "NOTICE.md").read_text()
    assert hashlib.sha256(wasm).hexdigest() == codec.WASM_SHA256 and codec.WASM_SHA256 in notice


WITHOUT_ENGINE = """
import sys
sys.modules["py_mini_racer"] = None
import numpy as np
from lightwell import basisu
basisu.encode(np.zeros((8, 8, 3), np.uint8), "uastc")
"""


def test_a_missing_engine_is_one_line():
    ended = subprocess.run([sys.executable, "-c", WITHOUT_ENGINE], capture_output=True, text=True)
    assert ended.returncode == 1
    assert re.search(r"RuntimeError: .*mini-racer; pip install 'lightwell\[ktx2\]'", ended.stderr.splitlines()[-1])
