"""Encodes and decodes KTX 2.0 files of Basis Universal: blocks that browsers turn into BC7, ASTC or ETC2 for their GPU.

The encoder is Basis Universal 2.5 (Binomial LLC, Apache-2.0) compiled to WebAssembly, from the npm package ktx2-encoder
0.6.0; ``tools/basis_encoder.py`` puts it here. It runs in V8, of the Python package mini-racer, with one thread: the
same texels give the same bytes on every machine.

References: Khronos, *KTX File Format Specification 2.0*; KHR_texture_basisu; Binomial, *UASTC LDR 4x4 texture
specification*.
"""

from __future__ import annotations

import struct
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from threading import Lock
from typing import Any

import numpy as np

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
# Places of width and height, and of the offset of the data format descriptor, in the header.
SIZE_AT, DESCRIPTOR_AT, HEADER_BYTES = 20, 48, 80
# Place of the colour model in the descriptor, and that of ETC1S (Khronos Data Format Specification 1.3).
MODEL_AT, MODEL_ETC1S = 12, 163
# SHA-256 of the WebAssembly, as the npm package states it.
WASM_SHA256 = "9807719e87cf3d979b0d69ae7112eb88aec6a0e0206c0b2d00dc0bed0d581b80"
# Edge of a block in texels.
BLOCK = 4
# Bytes of a block on the GPU: BC7 or ASTC of UASTC; BC1 or ETC1 of ETC1S.
CODECS = {"uastc": 16, "etc1s": 8}
# Basis Universal's own defaults: level 2 of UASTC loses 0.8 dB to the slowest, level 2 of ETC1S.
LEVEL = 2
CURE = "pip install 'lightwell[ktx2]'"
# Seconds in which the WebAssembly must have started, also on a busy machine.
START_SECONDS = 600

_LOCK = Lock()


def missing() -> str:
    """Tell whether the codec can run.

    Returns:
        What is missing and the cure; '' when nothing is.
    """
    return "" if find_spec("py_mini_racer") else f"KTX2 pictures need the Python package mini-racer; {CURE}"


def is_ktx2(data: bytes) -> bool:
    """Tell whether a file is a KTX 2.0 file.

    Args:
        data: Bytes of the file.

    Returns:
        Whether it starts as one.
    """
    return data[: len(IDENTIFIER)] == IDENTIFIER


def size(data: bytes) -> tuple[int, int]:
    """Read the size of a KTX 2.0 picture from its header.

    Args:
        data: Bytes of the file.

    Returns:
        Width and height in texels.

    Raises:
        ValueError: The file is cut short.
    """
    if len(data) < HEADER_BYTES:
        raise ValueError(f"KTX2: {len(data)} bytes, expected a header of {HEADER_BYTES}; encode the picture again")
    width, height = struct.unpack_from("<2I", data, SIZE_AT)
    return width, height


def block_bytes(data: bytes) -> int:
    """Find the bytes of a block on the GPU.

    Args:
        data: Bytes of a KTX2 file of Basis Universal.

    Returns:
        Bytes of 4 × 4 texels.
    """
    (descriptor,) = struct.unpack_from("<I", data, DESCRIPTOR_AT)
    return CODECS["etc1s" if data[descriptor + MODEL_AT] == MODEL_ETC1S else "uastc"]


def encode(texels: np.ndarray, codec: str, mips: int = 0) -> bytes:
    """Encode texels as numbers, without a transfer function.

    Args:
        texels: [H, W, 3] uint8; H and W are multiples of 4.
        codec: "uastc", 8 bits per texel, or "etc1s", 4 bits per texel with more error.
        mips: Number of mip levels below the first, each made of means of 2 × 2 texels.

    Returns:
        Bytes of the KTX2 file.

    Raises:
        ValueError: An edge is no multiple of 4.
        RuntimeError: mini-racer is missing, or the encoder refuses the texels.
    """
    height, width = texels.shape[:2]
    if height % BLOCK or width % BLOCK:
        raise ValueError(f"KTX2: {width} x {height} texels, expected multiples of {BLOCK}; give a --size of 16 or more")
    rgba = np.full((height, width, 4), 255, np.uint8)
    rgba[..., :3] = texels
    with _LOCK:
        engine = _engine()
        _fill(engine, "texels", rgba.tobytes())
        count = engine.eval(f"encode({width}, {height}, {'true' if codec == 'uastc' else 'false'}, {LEVEL}, {mips})")
        if not count:
            raise RuntimeError(f"KTX2: the encoder refuses {width} x {height} texels; encode them without --compress")
        return bytes(engine.eval("file.buffer"))


def decode(data: bytes, level: int = 0) -> np.ndarray:
    """Decode a level of a KTX2 file, as a GPU without compressed textures would be given it.

    Args:
        data: Bytes of the file.
        level: Mip level, 0 for the largest.

    Returns:
        [H, W, 3] uint8.

    Raises:
        ValueError: The file is broken, of another codec, or has no such level.
        RuntimeError: mini-racer is missing.
    """
    return decode_with_alpha(data, level)[..., :3].copy()


def decode_with_alpha(data: bytes, level: int = 0) -> np.ndarray:
    """Decode a level of a KTX2 file with its alpha, as ``decode`` does without.

    Args:
        data: Bytes of the file.
        level: Mip level, 0 for the largest.

    Returns:
        [H, W, 4] uint8; alpha is 255 where the file has none.

    Raises:
        ValueError: The file is broken, of another codec, or has no such level.
        RuntimeError: mini-racer is missing.
    """
    size(data)
    with _LOCK:
        engine = _engine()
        _fill(engine, "file", data)
        try:
            answer = engine.eval(f"decode({level})")
        except _errors() as error:
            # WebAssembly that was stopped inside a call is not used again.
            _engine.cache_clear()
            raise ValueError(
                f"KTX2: the file is broken ({str(error).splitlines()[0][:80]}); encode it again"
            ) from error
        if not answer[0].isdigit():
            raise ValueError(f"KTX2: {answer}; encode the picture again")
        width, height = map(int, answer.split())
        texels = np.frombuffer(bytes(engine.eval("texels.buffer")), np.uint8)
    return texels.reshape(height, width, 4)


def _fill(engine: Any, name: str, data: bytes) -> None:
    """Give bytes to the engine under a name."""
    engine.eval(f"bytes('{name}', {len(data)})")[:] = data


def _errors() -> tuple[type[Exception], ...]:
    """What JavaScript throws, also when WebAssembly reads beyond its memory."""
    from py_mini_racer import JSEvalException

    return (JSEvalException,)


@cache
def _engine() -> Any:
    """A V8 with the encoder started; starting takes longer than encoding a small picture."""
    try:
        from py_mini_racer import MiniRacer
    except ImportError as error:
        raise RuntimeError(missing() or f"KTX2 pictures need mini-racer; {CURE}") from error
    engine = MiniRacer()
    engine.eval(files("lightwell.basisu").joinpath("driver.js").read_text("utf-8"))
    # An ES module: a script has neither exports nor an address of its own.
    script = stored("basis_encoder.js").decode().replace("export default BASIS;", "").replace("import.meta.url", '""')
    engine.eval(script)
    _fill(engine, "wasm", stored("basis_encoder.wasm"))
    engine.eval("start()").get(timeout=START_SECONDS)
    return engine


def stored(name: str) -> bytes:
    """Read a file of the encoder.

    Args:
        name: ``basis_encoder.js`` or ``basis_encoder.wasm``.

    Returns:
        Its bytes.
    """
    import lzma

    return lzma.decompress(files("lightwell.basisu").joinpath(f"{name}.xz").read_bytes())
