"""Records of weights in a probe file: as many bytes as a function needs, in whole texels of four words.

Grids are bytes, x fastest. A network is ordered for the shader that evaluates it: the rows of its first layer as
(x, y, z, bias), the rows of its second, their biases, the last layer, its bias, and the three steps as floats.
"""

from __future__ import annotations

import numpy as np

from lightwell.probes.weights import FUNCTIONS, core
from lightwell.probes.weights.mlp import HIDDEN, TinyMlp
from lightwell.probes.weights.product import SMOOTH_HIGH, SMOOTH_LOW, ProductField
from lightwell.probes.weights.relu import decode, encode

# Bytes of a network without its steps, padded to whole words.
NETWORK = 116
# Largest step of a network that is read.
STEEPEST = 1e4
_SPAN = SMOOTH_HIGH - SMOOTH_LOW


def words_of(function: str) -> int:
    """Return the size of a record.

    Args:
        function: Name of the weight function.

    Returns:
        Number of 32-bit words, a multiple of four.
    """
    f = core(FUNCTIONS[function])
    size = NETWORK + 12 if isinstance(f, TinyMlp) else f.parameters
    return -(-size // 16) * 4


def encode_weights(function: str, params: np.ndarray) -> np.ndarray:
    """Encode parameters as records.

    Args:
        function: Name of the weight function.
        params: [R, C] quantised parameters.

    Returns:
        [R, words] uint32.
    """
    f = core(FUNCTIONS[function])
    out = np.zeros((len(params), 4 * words_of(function)), np.uint8)
    if isinstance(f, TinyMlp):
        out[:, :NETWORK], out[:, NETWORK : NETWORK + 12] = _network(f, params)
    else:
        sharp = f.sharp**3 if isinstance(f, ProductField) else f.parameters
        out[:, :sharp] = encode(params[:, :sharp])
        out[:, sharp : f.parameters] = np.clip(np.rint((params[:, sharp:] - SMOOTH_LOW) / _SPAN * 255), 0, 255)
    return out.view("<u4")


def decode_weights(function: str, words: np.ndarray, name: str) -> np.ndarray:
    """Decode records to parameters.

    Args:
        function: Name of the weight function.
        words: [R, words] uint32.
        name: Name of the file, for messages.

    Returns:
        [R, C] float32 parameters.
    """
    f, data = core(FUNCTIONS[function]), np.ascontiguousarray(words).view(np.uint8)
    if isinstance(f, TinyMlp):
        return _of_network(data, name)
    sharp = f.sharp**3 if isinstance(f, ProductField) else f.parameters
    smooth = data[:, sharp : f.parameters] * (_SPAN / 255) + SMOOTH_LOW
    return np.concatenate([decode(data[:, :sharp]), smooth.astype(np.float32)], axis=1)


def _network(f: TinyMlp, params: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[R, 116] bytes and [R, 12] bytes of the three steps."""
    steps = f.steps(params).astype("<f4")
    w1, b1, w2, b2, w3, b3 = f.parts(params)
    code = lambda values, k: np.rint(values.reshape(len(params), -1) / steps[:, k, None]).astype(np.int8)  # noqa: E731
    first = np.concatenate([w1, b1[..., None]], axis=2)
    parts = [code(first, 0), code(w2, 1), code(b2, 1), code(w3, 2), code(b3, 2)]
    rows = np.concatenate(parts, axis=1)
    return np.pad(rows, ((0, 0), (0, NETWORK - rows.shape[1]))).view(np.uint8), steps.view(np.uint8)


def _of_network(data: np.ndarray, name: str) -> np.ndarray:
    code = data[:, :NETWORK].view(np.int8).astype(np.float32)
    steps = np.ascontiguousarray(data[:, NETWORK : NETWORK + 12]).view("<f4")
    if len(steps) and not (np.isfinite(steps).all() and np.abs(steps).max() < STEEPEST):
        raise ValueError(f"{name}: damaged, expected finite weights; bake it again")
    split = 4 * HIDDEN
    first = code[:, :split].reshape(-1, HIDDEN, 4) * steps[:, 0, None, None]
    second = code[:, split : split + HIDDEN**2 + HIDDEN] * steps[:, 1, None]
    third = code[:, split + HIDDEN**2 + HIDDEN : split + HIDDEN**2 + 2 * HIDDEN + 1] * steps[:, 2, None]
    parts = [first[..., :3].reshape(len(code), -1), first[..., 3], second, third]
    return np.concatenate(parts, axis=1).astype(np.float32)
