"""Run native code that may crash, hang or use too much memory on an untrusted file in a separate process.

The worker process imports one function, ``module:name``, and answers requests with it: named arrays in, named arrays
out. Messages carry no pickled objects, so a worker whose memory was damaged cannot run code in the calling process.

    with Worker("lightwell.exr.worker:decode", seconds=30, memory=1 << 30) as worker:
        arrays = worker.ask({"path": np.array("frame.exr"), ...}, most_bytes=1 << 28)
"""

from __future__ import annotations

import contextlib
import importlib
import json
import math
import os
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from typing import IO

import numpy as np

Arrays = dict[str, np.ndarray]
# Length of the description of a message, bytes; the longest description that is read.
LENGTH = struct.Struct("<I")
MOST_DESCRIPTION = 1 << 22
# Element types that a message may hold: booleans, integers, floats, text and bytes.
KINDS = "biufUS"
# Address space of an idle worker with NumPy and its threads, bytes; added to every memory limit.
IDLE_MEMORY = 1 << 30


class WorkerDied(RuntimeError):
    """The worker process crashed, or was killed because it exceeded its time or answer size; the text says which."""


class WorkerError(ValueError):
    """The function in the worker process raised an error; the text is its message on one line."""


class Worker:
    """A process that answers requests with one function; use as a context manager. It starts at the first request.

    After the process has died, the next request starts a new one.

    Args:
        function: ``module:name`` of a function that takes and returns named arrays.
        seconds: Time limit of one request, including the start of the process.
        memory: Bytes that a request may use beyond an idle process (where the system can limit it: Linux, macOS).
    """

    def __init__(self, function: str, *, seconds: float, memory: int) -> None:
        self._function, self._seconds, self._memory = function, seconds, memory
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def ask(self, request: Mapping[str, np.ndarray], most_bytes: int) -> Arrays:
        """Send a request and wait for its answer.

        Args:
            request: Name → array of any shape, of booleans, numbers, text or bytes.
            most_bytes: Largest answer that is read, bytes.

        Returns:
            The named arrays that the function returned.

        Raises:
            WorkerDied: The process crashed, took too long, or its answer is larger than ``most_bytes``.
            WorkerError: The function raised an error.
            BaseException: The calling thread was interrupted; the process is ended first.
        """
        process = self._process or self._start()
        assert process.stdin is not None and process.stdout is not None
        late = threading.Event()

        def end() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(self._seconds, end)
        timer.daemon = True
        timer.start()
        try:
            send(process.stdin, request)
            return receive(process.stdout, most_bytes)
        except WorkerError:
            raise
        except (OSError, EOFError, ValueError) as error:
            code = self.stop()
            if late.is_set():
                raise WorkerDied(f"took over {self._seconds:g} s") from None
            raise WorkerDied(_cause(code, error)) from None
        except BaseException:
            # The rest of a partly read answer would be taken for the next answer.
            self.stop()
            raise
        finally:
            timer.cancel()

    def _start(self) -> subprocess.Popen[bytes]:
        # The other process imports the same modules as this one.
        program = (
            "import sys; sys.path[:] = sys.argv[3:]; from lightwell.core.isolated import serve; serve(*sys.argv[1:3])"
        )
        self._process = subprocess.Popen(
            [sys.executable, "-c", program, self._function, str(self._memory), *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        return self._process

    def stop(self) -> int:
        """End the process if it is running.

        Returns:
            Its exit code, negative for a signal; 0 when there is no process.
        """
        if self._process is None:
            return 0
        process, self._process = self._process, None
        code = process.poll()
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                if pipe is not None:
                    pipe.close()
        if code is None:
            # A process that has crashed closes its pipes a moment before it can be waited for.
            try:
                code = process.wait(0.2)
            except subprocess.TimeoutExpired:
                process.kill()
                code = process.wait()
        return code


def _cause(code: int, error: BaseException) -> str:
    """Describe in a few words why a worker process has ended."""
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"crashed, {signal.Signals(-code).name}"
    return " ".join(str(error).split()) if isinstance(error, ValueError) else f"ended with code {code}"


# ---------------------------------------------------------------------- messages


def send(stream: IO[bytes], arrays: Mapping[str, np.ndarray], error: str = "") -> None:
    """Write a message: the length of a JSON description, the description, the bytes of every array.

    Args:
        stream: Pipe to write to.
        arrays: Name → array of any shape.
        error: Message of an error to send instead of a result; empty for none.

    Raises:
        TypeError: An array holds elements other than numbers, text or bytes.
    """
    ready = {name: np.require(value, requirements="C") for name, value in arrays.items()}
    for name, value in ready.items():
        if value.dtype.kind not in KINDS:
            raise TypeError(f"isolated: '{name}' holds {value.dtype}; expected numbers, text or bytes")
    table = [[name, value.dtype.str, list(value.shape)] for name, value in ready.items()]
    description = json.dumps({"error": error, "arrays": table}).encode()
    stream.write(LENGTH.pack(len(description)) + description)
    for value in ready.values():
        if value.nbytes:
            stream.write(value.reshape(-1).view(np.uint8).data)
    stream.flush()


def receive(stream: IO[bytes], most_bytes: int) -> Arrays:
    """Read a message that ``send`` has written.

    A stream that ends inside the message raises ``EOFError``.

    Args:
        stream: Pipe to read from.
        most_bytes: Largest sum of the arrays' sizes that is accepted, bytes.

    Returns:
        Name → array.

    Raises:
        WorkerError: The message carries an error.
        ValueError: The message is malformed or too large.
    """
    (length,) = LENGTH.unpack(_exactly(stream, LENGTH.size))
    if length > MOST_DESCRIPTION:
        raise ValueError("sent a malformed answer")
    found = json.loads(_exactly(stream, length))
    if found["error"]:
        raise WorkerError(str(found["error"]))
    arrays: Arrays = {}
    for name, kind, shape in found["arrays"]:
        dtype = np.dtype(kind)
        count = math.prod(shape)
        most_bytes -= count * dtype.itemsize
        if dtype.kind not in KINDS or count < 0 or most_bytes < 0:
            raise ValueError("sent an answer that is too large")
        arrays[name] = np.empty(shape, dtype)
        if arrays[name].nbytes:
            _fill(stream, arrays[name].reshape(-1).view(np.uint8).data)
    return arrays


def _exactly(stream: IO[bytes], count: int) -> bytes:
    data = stream.read(count)
    if len(data) < count:
        raise EOFError("the stream has ended")
    return data


def _fill(stream: IO[bytes], target: memoryview) -> None:
    """Read into all of ``target``."""
    at = 0
    while at < len(target):
        got = stream.readinto(target[at:])  # type: ignore[attr-defined]
        if not got:
            raise EOFError("the stream has ended")
        at += got


# ---------------------------------------------------------------------- the other process


def serve(function: str, memory: str) -> None:
    """Answer requests from standard input until it ends, then exit the process without clean-up.

    Args:
        function: ``module:name`` of the function that answers.
        memory: Bytes that a request may use beyond an idle process, as a decimal number.
    """
    # Ctrl-C is handled by the parent process, which ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    # Text that native code prints must not mix with the answers.
    os.dup2(2, 1)
    _limit_memory(int(memory))
    code = 1
    with contextlib.suppress(EOFError, OSError):
        module, name = function.split(":")
        answer = getattr(importlib.import_module(module), name)
        for request in _requests(requests):
            try:
                found, problem = answer(request), ""
            except MemoryError:
                found, problem = {}, f"needs more than {int(memory) >> 20} MB of memory"
            except Exception as error:
                found, problem = {}, " ".join(str(error).split())[:500] or type(error).__name__
            send(answers, found, problem)
        code = 0
    os._exit(code)


def _requests(stream: IO[bytes]) -> Iterator[Arrays]:
    """Yield requests until the stream ends; they come from the parent process, so their size is not limited."""
    while True:
        try:
            yield receive(stream, sys.maxsize)
        except EOFError:
            return


def _limit_memory(memory: int) -> None:
    """Limit the address space and disable core files, where the system supports it."""
    try:
        import resource
    except ImportError:
        return
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (memory + IDLE_MEMORY, memory + IDLE_MEMORY))
