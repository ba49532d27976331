"""The one door to Mitsuba and Dr.Jit: finds LLVM, picks a variant, explains a failure and its cure.

Every other module writes ``from lightwell.backend import dr, mi`` and never imports Mitsuba itself, so that the
variant is chosen once and before anything else happens.
"""

from __future__ import annotations

import functools
import os
import platform
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from lightwell import machine

# The variants lightwell knows, best first. Both are RGB, single precision and differentiable.
VARIANTS = ("cuda_ad_rgb", "llvm_ad_rgb")

# Mitsuba 3.9 refuses or aborts with LLVM older than this.
MINIMUM_LLVM = 17


@dataclass(frozen=True)
class Backend:
    """What runs the numbers."""

    variant: str
    """Mitsuba variant, one of ``VARIANTS``."""
    llvm: str
    """Path of the LLVM library in use; empty on CUDA or when Dr.Jit found one by itself."""
    threads: int
    """Worker threads of Dr.Jit."""


def _bundled_llvm() -> str:
    """Path of the LLVM that the package ``karellen-llvm-core`` put into this environment, or an empty string."""
    for root in (Path(sys.prefix) / "lib", Path(sys.base_prefix) / "lib"):
        found = sorted(root.glob("libLLVM.so*"))
        if found:
            return str(found[0])
    return ""


def cure(system: str = sys.platform, processor: str = platform.machine()) -> str:
    """Say how to get a working backend on a machine.

    Args:
        system: Its operating system, as ``sys.platform`` names it.
        processor: Its processor, as ``platform.machine`` names it.

    Returns:
        One line.
    """
    if system == "darwin":
        return "install LLVM with 'brew install llvm' and set DRJIT_LIBLLVM_PATH to its libLLVM.dylib"
    if system == "win32":
        return f"install LLVM >= {MINIMUM_LLVM} from llvm.org and set DRJIT_LIBLLVM_PATH to its LLVM-C.dll"
    installed = f"install a system LLVM >= {MINIMUM_LLVM} and set DRJIT_LIBLLVM_PATH to its libLLVM.so"
    if processor in ("x86_64", "AMD64"):
        return f"run 'pip install karellen-llvm-core' (Linux x86-64), or {installed}"
    return f"{installed} (Debian, Ubuntu: apt-get install llvm-18)"


def keep_installed_plugins(mitsuba: ModuleType) -> None:
    """Make Mitsuba look for its plug-ins and data in its own folder only.

    By itself it looks into the working folder first: ``plugins/diffuse.so`` there, a stranger's code, would be loaded
    in place of the installed plug-in.

    Args:
        mitsuba: The module, just imported; no plug-in must have been loaded yet.
    """
    resolver = mitsuba.file_resolver()
    resolver.clear()
    resolver.append(str(Path(str(mitsuba.__file__)).resolve().parent))


@contextmanager
def _interrupts_later() -> Iterator[None]:
    """Hold Ctrl-C back while native modules initialise: an exception in their callbacks would abort the process."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: received.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL if before is None else before)
        if received:
            signal.raise_signal(signal.SIGINT)


def _select() -> Backend:
    if not os.environ.get("DRJIT_LIBLLVM_PATH") and (path := _bundled_llvm()):
        os.environ["DRJIT_LIBLLVM_PATH"] = path
    try:
        import drjit
        import mitsuba
    except ImportError as error:
        raise RuntimeError(f"backend: cannot import Mitsuba ({error}); run 'pip install lightwell' again") from error
    keep_installed_plugins(mitsuba)

    wanted = os.environ.get("LIGHTWELL_VARIANT")
    candidates = (wanted,) if wanted else VARIANTS
    reasons = []
    for variant in candidates:
        if variant not in mitsuba.variants():
            reasons.append(f"{variant}: not in this Mitsuba, which has {', '.join(mitsuba.variants())}")
            continue
        backend = drjit.JitBackend.CUDA if variant.startswith("cuda") else drjit.JitBackend.LLVM
        if not drjit.has_backend(backend):
            reasons.append(f"{variant}: no usable {backend.name} on this machine")
            continue
        mitsuba.set_variant(variant)
        mitsuba.set_log_level(mitsuba.LogLevel.Error)
        llvm = os.environ.get("DRJIT_LIBLLVM_PATH", "") if backend == drjit.JitBackend.LLVM else ""
        drjit.set_thread_count(machine.threads())
        return Backend(variant, llvm, drjit.thread_count())
    raise RuntimeError(f"backend: no backend works ({'; '.join(reasons)}); {cure()}")


with _interrupts_later():
    ACTIVE = _select()

import drjit as dr  # noqa: E402  (the variant must be chosen first)
import mitsuba as mi  # noqa: E402

__all__ = [
    "ACTIVE", "MINIMUM_LLVM", "VARIANTS", "Backend", "aligned", "cure", "dr", "freeze", "mi", "two_threads",
    "upload_floats", "upload_integers",
]  # fmt: skip

# Bytes of the widest vector registers.
ALIGNMENT = 64

# Dr.Jit 1.5 records and replays frozen functions in one thread at a time: replays in two threads end with "determining
# size of variable" or with wrong numbers.
_ONE_AT_A_TIME = threading.RLock()


def freeze(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """Record the kernels of a function at its first call and replay them later, in one thread at a time.

    Args:
        function: Function of Dr.Jit arrays and objects that hold them.
        **options: Options of ``dr.freeze``.

    Returns:
        The function, whose calls from several threads run one after the other.
    """
    frozen = dr.freeze(function, **options)

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        with _ONE_AT_A_TIME:
            return frozen(*arguments)

    return call


@contextmanager
def two_threads() -> Iterator[None]:
    """Give Dr.Jit at least two worker threads for a while.

    Mitsuba 3.9 reads and writes EXR files in tasks that wait for other tasks: with one thread they wait for ever.

    Yields:
        Nothing: inside of the block there are two threads or more.
    """
    count = dr.thread_count()
    if count > 1:
        yield
        return
    dr.set_thread_count(2)
    try:
        yield
    finally:
        dr.set_thread_count(count)


def aligned(array: np.ndarray, kind: type) -> np.ndarray:
    """Copy an array to memory that begins at a multiple of ``ALIGNMENT`` bytes.

    Dr.Jit wraps the memory of a NumPy array without copying it, and writes its alignment into the kernels that read it:
    for memory with another alignment they are compiled anew, and frozen functions are recorded again.

    Args:
        array: [...] numbers.
        kind: NumPy type of the copy.

    Returns:
        [...] the same numbers.
    """
    array = np.asarray(array, kind)
    memory = np.empty(array.nbytes + ALIGNMENT, np.uint8)
    begin = -memory.ctypes.data % ALIGNMENT
    copy: np.ndarray = memory[begin : begin + array.nbytes].view(kind).reshape(array.shape)
    copy[...] = array
    return copy


def upload_floats(array: np.ndarray) -> Any:
    """Copy numbers to the device.

    Args:
        array: [n] numbers.

    Returns:
        Float of width n.
    """
    return mi.Float(aligned(array, np.float32))


def upload_integers(array: np.ndarray) -> Any:
    """Copy integers to the device.

    Args:
        array: [n] numbers of 0 … 2³² − 1.

    Returns:
        UInt32 of width n.
    """
    return mi.UInt32(aligned(array, np.uint32))
