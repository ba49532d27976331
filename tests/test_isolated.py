"""The worker process: arrays there and back, errors, crashes, time, memory, size of the answer."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from lightwell.core.isolated import Worker, WorkerDied, WorkerError

HERE = "tests.test_isolated"
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the address space reliably")


# ---------------------------------------------------------------------- functions that the worker runs


def echo(request):
    return request


def process(request):
    return {"id": np.array(os.getpid())}


def misbehave(request):
    """What native code does at its worst, by name."""
    what = str(request["what"])
    if what == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    elif what == "hang":
        time.sleep(60)
    elif what == "memory":
        return {"big": np.ones(1 << 31, np.uint8)}
    elif what == "large":
        return {"big": np.ones(1 << 20, np.uint8)}
    elif what == "print":
        os.write(1, b"words of native code")
        return {"ok": np.array(True)}
    raise ValueError("a reason\nover two lines")


# ---------------------------------------------------------------------- tests


def _worker(name, **more):
    return Worker(f"{HERE}:{name}", **{"seconds": 20, "memory": 1 << 28, **more})


def test_arrays_come_back_as_they_were():
    arrays = {
        "half": np.arange(6, dtype=np.float16).reshape(2, 3), "text": np.array("größe"), "none": np.zeros((0, 4)),
        "raw": np.frombuffer(b"a\0b\0", "S1"), "turned": np.arange(6).reshape(2, 3).T,
    }  # fmt: skip
    with _worker("echo") as worker:
        found = worker.ask(arrays, 1 << 20)
    assert list(found) == list(arrays)
    assert all(found[k].dtype == v.dtype and np.array_equal(found[k], v) for k, v in arrays.items())


def test_one_process_answers_many_requests_and_ends_with_its_context():
    with _worker("process") as worker:
        first, second = (int(worker.ask({}, 1 << 10)["id"]) for _ in range(2))
    assert first == second != os.getpid()
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)


@pytest.mark.parametrize(
    ("what", "kind", "text"),
    [
        ("crash", WorkerDied, "crashed, SIGSEGV"),
        ("large", WorkerDied, "too large"),
        ("raise", WorkerError, "^a reason over two lines$"),
        pytest.param(
            "memory",
            WorkerError,
            "needs more than 256 MB",
            marks=pytest.mark.skipif(sys.platform != "linux", reason=""),
        ),
    ],
)
def test_what_goes_wrong_is_one_line_and_the_next_request_is_answered(what, kind, text):
    with _worker("misbehave") as worker:
        with pytest.raises(kind, match=text):
            worker.ask({"what": np.array(what)}, 1 << 16)
        assert worker.ask({"what": np.array("print")}, 1 << 16)["ok"]


def test_a_hang_ends_at_the_time_limit():
    start = time.monotonic()
    with _worker("misbehave", seconds=1.5) as worker, pytest.raises(WorkerDied, match=r"took over 1.5 s"):
        worker.ask({"what": np.array("hang")}, 1 << 16)
    assert time.monotonic() - start < 15


def test_pickled_objects_are_not_sent():
    with _worker("echo") as worker, pytest.raises(TypeError, match="expected numbers"):
        worker.ask({"objects": np.array([None], object)}, 1 << 16)


def test_a_worker_ends_when_the_process_that_asks_is_killed():
    program = (
        "import numpy as np, os, signal; from lightwell.core.isolated import Worker\n"
        f"w = Worker('{HERE}:process', seconds=20, memory=1 << 28)\n"
        "print(int(w.ask({}, 1 << 10)['id']), flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    child = int(done.stdout)
    for _ in range(100):
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("the worker is still there")
