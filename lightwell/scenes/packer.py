"""Cut meshes into charts and pack charts into an atlas with xatlas, in a separate process.

xatlas 0.0.11 must not run in the main process: it works on a mesh in a thread while the next one is added and moves
the list of meshes under that thread, which crashes about once in a few hundred atlases; and freeing an atlas may wait
for its own threads for ever, about once in ten thousand. Therefore the other process gives every mesh that is cut an
atlas of its own, frees none, and exits without clean-up; a crash over a mesh is reported as an error here.

Notation: meshes of V vertices and K triangles; messages are npz archives behind their length in bytes.
"""

from __future__ import annotations

import io
import os
import signal
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any, cast

import numpy as np

Flat = tuple[np.ndarray, np.ndarray]
# Threads that one process may accumulate, because no atlas is freed; least number of atlases per process.
THREADS, LEAST_ATLASES = 2048, 32
# Attempts per request; the second one uses a new process.
ATTEMPTS = 2
SIZE = struct.Struct("<Q")


@dataclass(frozen=True)
class Packing:
    """Charts packed into one atlas."""

    width: int
    height: int
    """Texels."""
    squares: int
    """Number of atlases that the charts needed."""
    charts: int
    meshes: tuple[Flat, ...]
    """Points [V, 2] float32 in texels and corners [K, 3] uint32 of every mesh."""

    @property
    def extent(self) -> float:
        """Texels along the longer edge; infinite where one atlas was not enough."""
        return max(self.width, self.height) if self.squares == 1 else np.inf


class Packer:
    """A process that cuts and packs; use as a context manager.

    Its methods raise ``ValueError`` where the process dies twice over the same request.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._atlases = 0

    def __enter__(self) -> Packer:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    def cut(self, meshes: Sequence[Flat], texels: float) -> tuple[list[Flat], int]:
        """Cut meshes into charts and flatten each mesh by itself.

        Args:
            meshes: Positions [V, 3] float32 and corners [K, 3] uint32 of every mesh.
            texels: Texels per unit of the positions, > 0.

        Returns:
            Points [V', 2] float32 in texels and corners [K, 3] uint32 of every mesh; number of charts of all meshes.
        """
        flat: list[Flat] = []
        charts = 0
        for start in range(0, len(meshes), self._most):
            part = meshes[start : start + self._most]
            found = self._ask(part, {"task": "cut", "texels": texels}, len(part))
            flat += found.meshes
            charts += found.charts
        return flat, charts

    @property
    def process_id(self) -> int | None:
        """Number of the running process; None: there is none."""
        return None if self._process is None else self._process.pid

    def pack(self, charts: Sequence[Flat], pad: int, brute: bool) -> Packing:
        """Pack charts into one atlas.

        Args:
            charts: Points [V, 2] float32 in texels and corners [K, 3] uint32 of every chart.
            pad: Texels between charts, ≥ 0.
            brute: Try every position for each chart, which is slower and packs more tightly.

        Returns:
            The packed charts.
        """
        return self._ask(charts, {"task": "pack", "pad": pad, "brute": brute}, 1)

    @property
    def _most(self) -> int:
        return max(THREADS // max((os.cpu_count() or 1) - 1, 1), LEAST_ATLASES)

    def _ask(self, meshes: Sequence[Flat], settings: Mapping[str, object], atlases: int) -> Packing:
        arrays = {name: np.asarray(value) for name, value in settings.items()}
        arrays |= joined(meshes)
        if self._atlases + atlases > self._most:
            self._stop()
        for _ in range(ATTEMPTS):
            process = self._process or self._start()
            assert process.stdin is not None and process.stdout is not None
            self._atlases += atlases
            try:
                send(process.stdin, arrays)
                answer = receive(process.stdout)
            except OSError:
                answer = None
            if answer is not None:
                width, height, squares, charts = (int(answer[n]) for n in ("width", "height", "squares", "charts"))
                return Packing(width, height, squares, charts, tuple(parted(answer)))
            code = self._stop()
        raise ValueError(
            f"atlas: the packer of charts ended with code {code}; clean the meshes (no zero-size or repeated "
            "triangles), or give them a second set of texture coordinates"
        )

    def _start(self) -> subprocess.Popen[bytes]:
        # The other process finds the same modules as this one, and imports of lightwell this file alone.
        program = "import runpy, sys; sys.path[:] = sys.argv[2:]; runpy.run_path(sys.argv[1])['serve']()"
        self._process = subprocess.Popen(
            [sys.executable, "-c", program, __file__, *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._atlases = 0
        return self._process

    def _stop(self) -> int:
        """End the process and return its exit code."""
        if self._process is None:
            return 0
        process, self._process, self._atlases = self._process, None, 0
        for pipe in filter(None, (process.stdin, process.stdout)):
            try:
                pipe.close()
            except OSError:
                pass
        if process.poll() is None:
            process.kill()
        return process.wait()


def joined(meshes: Sequence[Flat]) -> dict[str, np.ndarray]:
    """Put meshes behind one another: an archive of a few long arrays is read many times faster than one of thousands.

    Args:
        meshes: Points [V, D] and corners [K, 3] of every mesh, one at least.

    Returns:
        Name → array, for ``parted``.
    """
    points, corners = zip(*meshes)
    return {
        "points": np.concatenate(points).astype(np.float32),
        "corners": np.concatenate(corners).astype(np.uint32),
        "vertices": np.array([len(p) for p in points]),
        "triangles": np.array([len(c) for c in corners]),
    }


def parted(arrays: Mapping[str, np.ndarray]) -> list[Flat]:
    """Take meshes apart that ``joined`` has put together.

    Args:
        arrays: Name → array.

    Returns:
        Points and corners of every mesh.
    """
    points, corners = (
        np.split(arrays[name], np.cumsum(arrays[count])[:-1])
        for name, count in (("points", "vertices"), ("corners", "triangles"))
    )
    return list(zip(points, corners))


def send(stream: IO[bytes], arrays: Mapping[str, np.ndarray]) -> None:
    """Write a message: the length of an npz archive and the archive.

    Args:
        stream: Pipe to write to.
        arrays: Name → array of any shape.
    """
    body = io.BytesIO()
    # numpy declares its further options among the keywords.
    np.savez(body, **cast(dict[str, Any], arrays))
    stream.write(SIZE.pack(body.tell()))
    stream.write(body.getvalue())
    stream.flush()


def receive(stream: IO[bytes]) -> dict[str, np.ndarray] | None:
    """Read a message that ``send`` has written.

    Args:
        stream: Pipe to read from.

    Returns:
        Name → array; None where the stream ends before the message is complete.
    """
    head = stream.read(SIZE.size)
    if len(head) < SIZE.size:
        return None
    (size,) = SIZE.unpack(head)
    body = stream.read(size)
    if len(body) < size:
        return None
    with np.load(io.BytesIO(body), allow_pickle=False) as found:
        return {name: found[name] for name in found.files}


# ---------------------------------------------------------------------- the other process


def serve() -> None:
    """Answer requests from standard input until it ends, then exit without clean-up: the atlases are not freed."""
    # Ctrl-C reaches both processes; the parent reports it and closes the pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    kept: list[object] = []
    try:
        while (request := receive(requests)) is not None:
            send(answers, _answer(request, kept))
    except BaseException:
        os._exit(1)
    os._exit(0)


def _answer(request: Mapping[str, np.ndarray], kept: list[object]) -> dict[str, np.ndarray]:
    meshes = parted(request)
    if request["task"] == "cut":
        atlases = [_cut(mesh, float(request["texels"])) for mesh in meshes]
        found = [(atlas, 0) for atlas in atlases]
    else:
        atlases = [_pack(meshes, int(request["pad"]), bool(request["brute"]))]
        found = [(atlases[0], k) for k in range(len(meshes))]
    kept += atlases
    last = atlases[-1]
    sizes = {"width": last.width, "height": last.height, "squares": last.atlas_count}
    answer = {name: np.asarray(value) for name, value in sizes.items()}
    answer["charts"] = np.asarray(sum(atlas.chart_count for atlas in atlases))
    flat = []
    for atlas, number in found:
        _, corners, uv = atlas.get_mesh(number)
        flat.append(((uv * np.array([atlas.width, atlas.height], np.float32)).astype(np.float32), corners))
    return answer | joined(flat)


def _cut(mesh: Flat, texels: float) -> Any:
    import xatlas

    atlas = xatlas.Atlas()
    atlas.add_mesh(*mesh)
    atlas.generate(xatlas.ChartOptions(), _options(texels, 0, False))
    return atlas


def _pack(charts: Sequence[Flat], pad: int, brute: bool) -> Any:
    import xatlas

    atlas = xatlas.Atlas()
    for points, corners in charts:
        atlas.add_uv_mesh(points, corners)
    atlas.generate(xatlas.ChartOptions(), _options(1.0, pad, brute))
    return atlas


def _options(texels: float, pad: int, brute: bool) -> Any:
    import xatlas

    options = xatlas.PackOptions()
    options.padding, options.texels_per_unit, options.bruteForce = pad, texels, brute
    options.resolution, options.bilinear, options.rotate_charts = 0, True, True
    return options
