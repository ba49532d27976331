"""The Dr.Jit scatter beside the same loop in C and in Numba."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from lens_measure import all_pixels, median_seconds
from rows import Row, without_bar

from lightwell.lens import families
from lightwell.lens.bake import bake_node
from lightwell.lens.recipes import Recipe
from lightwell.lens.splat import Frame, Points, Sources, guard_for, splat

C_TWIN = """
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <omp.h>
void scatter(float *out, long size, const float *rgba, const int32_t *base, long n, const int32_t *delta,
             const float *value, long count) {
  int threads = omp_get_max_threads();
  float *copies = calloc((size_t)size * threads, 4);
  #pragma omp parallel
  {
    float *mine = copies + (size_t)size * omp_get_thread_num();
    #pragma omp for schedule(static)
    for (long i = 0; i < n; i++) {
      const float r = rgba[4*i], g = rgba[4*i+1], b = rgba[4*i+2], a = rgba[4*i+3];
      float *at = mine + 4L * base[i];
      for (long k = 0; k < count; k++) {
        float *p = at + 4L * delta[k]; const float v = value[k];
        p[0] += v*r; p[1] += v*g; p[2] += v*b; p[3] += v*a;
      }
    }
    #pragma omp for schedule(static)
    for (long j = 0; j < size; j++) {
      float s = 0;
      for (int t = 0; t < threads; t++) s += copies[(size_t)size * t + j];
      out[j] = s;
    }
  }
  free(copies);
}
"""


def _case(size: int) -> tuple[Points, Sources, Frame]:
    """Every pixel of a square picture with the same sparse disc."""
    family = families.depth(32.0)
    points = Points.of([dict(bake_node(family, family.size - 1, Recipe()))[0]])
    rgba = np.random.default_rng(0).random((size, size, 4)).astype(np.float32)
    return points, all_pixels(rgba, np.zeros((size, size))), Frame(size, size, guard_for(points, False))


def twin(quick: bool) -> list[Row]:
    """The Dr.Jit scatter over a C twin (gcc -O3 -march=native -fopenmp) of the same points."""
    what = "scatter: points per second of Dr.Jit over a C twin, radius 32 px"
    if shutil.which("gcc") is None:
        return [without_bar(what, None, "ratio", "no gcc here")]
    with tempfile.TemporaryDirectory() as folder:
        source, binary = Path(folder) / "twin.c", Path(folder) / "twin.so"
        source.write_text(C_TWIN)
        subprocess.run(
            ["gcc", "-O3", "-march=native", "-fopenmp", "-shared", "-fPIC", source, "-o", binary], check=True
        )
        library = ctypes.CDLL(str(binary))
        points, sources, frame = _case(128 if quick else 512)
        height, width = frame.padded
        base = ((sources.y + frame.guard) * width + sources.x + frame.guard).astype(np.int32)
        delta, out = (points.y * width + points.x).astype(np.int32), np.zeros((height, width, 4), np.float32)
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (out, sources.rgba, base, delta, points.value)]

        def run():
            library.scatter(
                pointers[0], ctypes.c_long(out.size), pointers[1], pointers[2], ctypes.c_long(len(base)), pointers[3],
                pointers[4], ctypes.c_long(len(delta)),
            )  # fmt: skip

        rounds = 1 if quick else 9
        theirs, ours = median_seconds(run, rounds), median_seconds(lambda: splat(frame, points, sources), rounds)
        same = np.abs(out - splat(frame, points, sources).charges).max() / np.abs(out).max()
        rate = len(base) * len(delta) / ours / 1e6
        note = (
            f"{rate:.0f} M RGBA points/s against {len(base) * len(delta) / theirs / 1e6:.0f}; they differ by {same:.0e}"
        )
    return [without_bar(what, theirs / ours, "ratio", note), _numba(quick)]


NUMBA_TWIN = """
import sys, time
import numpy as np
from numba import njit, prange

@njit(fastmath=True, parallel=True)
def scatter(copies, rgba, base, delta, value, threads):
    n = len(base)
    share = (n + threads - 1) // threads
    copies[:] = 0
    for t in prange(threads):
        mine = copies[t]
        for i in range(t * share, min(n, (t + 1) * share)):
            r, g, b, a = rgba[i, 0], rgba[i, 1], rgba[i, 2], rgba[i, 3]
            for k in range(len(delta)):
                j, v = 4 * (base[i] + delta[k]), value[k]
                copies[t, j] += r * v
                copies[t, j + 1] += g * v
                copies[t, j + 2] += b * v
                copies[t, j + 3] += a * v

data = np.load(sys.argv[1])
threads, rounds = int(sys.argv[2]), int(sys.argv[3])
copies = np.zeros((threads, int(data["size"])), np.float32)
times = []
for _ in range(rounds + 1):
    start = time.perf_counter()
    scatter(copies, data["rgba"], data["base"], data["delta"], data["value"], threads)
    copies.sum(0)
    times.append(time.perf_counter() - start)
print("SECONDS", float(np.median(times[1:])))
"""


def _numba(quick: bool) -> Row:
    """The same in Numba, by a Python that has it: LIGHTWELL_NUMBA."""
    what = "scatter: points per second of Dr.Jit over a Numba twin, radius 32 px"
    python = os.environ.get("LIGHTWELL_NUMBA")
    if not python or not Path(python).exists():
        return without_bar(what, None, "ratio", "needs LIGHTWELL_NUMBA, a Python that has numba")
    points, sources, frame = _case(128 if quick else 512)
    _, width = frame.padded
    with tempfile.TemporaryDirectory() as folder:
        data, script = Path(folder) / "data.npz", Path(folder) / "twin.py"
        base = ((sources.y + frame.guard) * width + sources.x + frame.guard).astype(np.int32)
        delta = (points.y * width + points.x).astype(np.int32)
        size = int(np.prod(frame.padded)) * 4
        np.savez(data, rgba=sources.rgba, base=base, delta=delta, value=points.value, size=size)
        script.write_text(NUMBA_TWIN)
        command = [python, script, data, str(os.cpu_count() or 1), "1" if quick else "9"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    line = next((text for text in done.stdout.splitlines() if text.startswith("SECONDS")), None)
    if line is None:
        raise RuntimeError(f"benchmark: Numba failed: {done.stderr[-500:]}")
    theirs, ours = float(line.split()[1]), median_seconds(lambda: splat(frame, points, sources), 1 if quick else 9)
    writes = len(sources.x) * len(points.x) / 1e6
    note = f"{writes / ours:.0f} M RGBA points/s against {writes / theirs:.0f}"
    return without_bar(what, theirs / ours, "ratio", note)
