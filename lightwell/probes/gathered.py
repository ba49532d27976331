"""Light in the air of many places of a light at once: a final gather over the irradiance of bins of surface.

Rays need no light. Those of a point are traced once; each keeps its direction, the bin of surface that it met, and what
an irradiance of 1 there is worth to the point. The irradiance of the bins is known for every light (``radiosity``), so
that the light in the air is a product, for as many lights as are wanted: all of them share the noise of the rays, and
differences between them are exact. A table of the sky's cells stands in for what rays that leave the scene meet.

What it blurs is what the bins blur: the bright spot beside a light.

Notation: N points, P rays per point, F bins, S lights.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_integers
from lightwell.probes.sh import TO_IRRADIANCE, basis
from lightwell.scenes.executor import Arrays
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.variables import PointLight, Sun, Variable, has_sky
from lightwell.transport.bins import Bins
from lightwell.transport.day_light import day_light
from lightwell.transport.gather_rays import beyond, ray_ends
from lightwell.transport.interactions import upload
from lightwell.transport.path_numbers import LATTICE_STREAM, random_streams, stratified
from lightwell.transport.radiosity import LANES, stored_ends
from lightwell.transport.row_tasks import rows_of
from lightwell.transport.seen_shards import SeenBins
from lightwell.transport.sky_source import CELLS
from lightwell.transport.tables import tables

# Points by which the bins are found, and bins that are aimed at.
SEEING, BINS = 1 << 16, 8192
# Points per visible object among those at least.
FLOOR = 64
# Random streams of the points, the bins and their light; places in a bin that shadow rays are traced to.
POINT_STREAM, BIN_STREAM, LIGHT_STREAM, BIN_SHADOWS = 0xA1, 0xA2, 0xA3, 4
# Numbers [points, rays, lights] that a product holds at a time.
AT_ONCE = 1 << 19
SPHERE = 4 * np.pi

BIN_LIGHT = Derived[np.ndarray]("probes.bin_light", most=2)


def gathers(variable: Variable | None) -> bool:
    """Tell whether the light of a variable is known in bins.

    Args:
        variable: The variable; None: the scene's own emitters.

    Returns:
        True for a light that moves in a box and for a sun, with or without a sky.
    """
    return isinstance(variable, (PointLight, Sun))


@dataclass(frozen=True)
class AirEnds:
    """Where the rays of N points in the air end."""

    bin: np.ndarray
    """[N, P] bin that the ray met; with a sky F + its cell where it left the scene; the last one is dark."""
    weight: np.ndarray
    """[N, P, 3] float16 radiance times solid angle for an irradiance of 1 there: a mean over a half of the rays."""
    way: np.ndarray
    """[N, P, 3] float32 directions."""

    def light(self, irradiance: np.ndarray) -> np.ndarray:
        """Compute the light that the rays bring.

        Args:
            irradiance: [F + 1, 3, S] irradiance of the bins under S lights; the last bin is dark.

        Returns:
            [2, S, N, 9, 3] float32 irradiance harmonics by each half of the rays.
        """
        count, rays = self.bin.shape
        lights, half = irradiance.shape[2], rays // 2
        out = np.empty((2, lights, count, 9, 3), np.float32)
        size = max(1, AT_ONCE // (rays * lights))
        seen = np.empty((size, 2, half, lights), np.float32)
        for c in range(3):
            of_bins = np.ascontiguousarray(irradiance[:, c])
            for start in range(0, count, size):
                part = slice(start, min(start + size, count))
                y = basis(self.way[part].reshape(-1, 3)) * TO_IRRADIANCE * self.weight[part, :, c].reshape(-1, 1)
                y = y.astype(np.float32).reshape(-1, 2, half, 9).swapaxes(2, 3)
                bins = self.bin[part].reshape(-1, 2, half)
                light = np.take(of_bins, bins, axis=0, out=seen[: len(bins)], mode="clip")
                out[:, :, part, :, c] = (y @ light).transpose(1, 3, 0, 2)
        return out


def gathered_light(
    scene: Scene,
    points: np.ndarray,
    rays: int,
    seed: int,
    *,
    variable: Variable,
    lights: np.ndarray,
    numbers: np.ndarray,
) -> np.ndarray:
    """Gather the light at points in air under many places of a light.

    Args:
        scene: The scene.
        points: [N, 3] points, metres.
        rays: Rays per point, even and ≥ 2.
        seed: Seed of the rays.
        variable: Declared light of 1 cd (1 lx) that ``gathers``; its direct light is left out, that of a sky is not.
        lights: [S, 3] its positions (or directions).
        numbers: [N] random streams of the points.

    Returns:
        [2, S, N, 9, 3] float32 irradiance harmonics by each half of the rays.
    """
    irradiance = bin_light(scene, variable, lights)
    return air_ends(scene, variable, points, rays, seed, numbers).light(irradiance)


def bin_light(scene: Scene, variable: Variable, lights: np.ndarray) -> np.ndarray:
    """Compute the irradiance of the bins under many lights; the last ones are kept with the scene.

    Args:
        scene: The scene.
        variable: The declared light.
        lights: [S, 3] its positions (or directions).

    Returns:
        [F + 1, 3, S] float32; with a sky the radiance of its cells stands behind the bins.
    """

    def make() -> np.ndarray:
        radiosity = _bins(variable).make(scene)[1]
        if has_sky(variable):
            found = day_light(radiosity, variable, lights, LIGHT_STREAM).irradiance
        else:
            shadows = [radiosity.direct(variable, lights, LIGHT_STREAM + (k << 20)) for k in range(BIN_SHADOWS)]
            direct = np.mean(shadows, axis=0)
            found = radiosity.indirect(direct) + direct
        return np.ascontiguousarray(found.transpose(1, 2, 0))

    return scene.cache.get(BIN_LIGHT, make, (variable, np.float32(lights).tobytes()))


def air_ends(
    scene: Scene, variable: Variable, points: np.ndarray, rays: int, seed: int, numbers: np.ndarray
) -> AirEnds:
    """Trace the rays of points in air.

    Args:
        scene: The scene.
        variable: The declared light, in whose box people look.
        points: [N, 3] points, metres.
        rays: Rays per point, even and ≥ 2.
        seed: Seed of the rays.
        numbers: [N] random streams of the points.

    Returns:
        Where they end.
    """
    bins = _bins(variable).make(scene)[1].bins
    settings = {"rays": rays, "seed": seed, "sky": has_sky(variable)}
    columns = {"point": np.asarray(points, np.float64), "stream": np.asarray(numbers).astype(np.uint32)}
    found = rows_of(scene, "air-ends", settings, columns, rays, bins.arrays())
    return AirEnds(found["bin"], found["weight"], found["way"])


def _bins(variable: Variable) -> SeenBins:
    return SeenBins(variable, SEEING, BINS, FLOOR, (POINT_STREAM, BIN_STREAM))


def air_end_rows(scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays) -> Arrays:
    """Trace rows of ``air_ends``; see ``row_tasks.RowFunction``.

    Args:
        scene: The scene.
        settings: ``rays``, ``seed`` and ``sky``.
        columns: ``point`` [N, 3] and ``stream`` [N].
        first: Not used: every row has the number of its stream.
        shared: ``Bins.arrays``.

    Returns:
        ``bin`` [N, P], ``weight`` and ``way`` [N, P, 3], as in ``AirEnds``.
    """
    tables(scene)
    bins, rays, sky = Bins.of(shared), settings["rays"], settings["sky"]
    place, stream = upload(mi.Point3f, columns["point"]), upload_integers(columns["stream"])
    count, batch = len(columns["stream"]), max(1, LANES // rays)
    dark = dr.opaque(mi.UInt32, bins.count + (CELLS if sky else 0))
    bin_of, weight = np.empty((count, rays), np.int32), np.empty((count, rays, 3), np.float16)
    way = np.empty((count, rays, 3), np.float32)
    for start in range(0, count, batch):
        size = min(batch, count - start)
        part = slice(start, start + size)
        (w, p, n, away), d = _launch(scene, place, stream, start, size, rays, settings["seed"])
        index = bins.lookup(scene.mi, p, n)
        if sky:
            w, index = beyond(bins.count, w, index, away)
        w, index = stored_ends(w, index, dr.opaque(mi.Float, SPHERE * 2 / rays), dark)
        dr.eval(w, index, d)
        bin_of[part] = np.array(index).reshape(size, rays)
        way[part] = np.array(d).T.reshape(size, rays, 3)
        for c, values in enumerate(w):
            weight[part, :, c] = np.array(values).reshape(size, rays)
    return {"bin": bin_of, "weight": weight, "way": way}


def _launch(scene: Scene, place: Any, streams: Any, start: int, count: int, rays: int, seed: int) -> tuple[Any, Any]:
    """Ends and directions of ``rays`` uniformly distributed rays from each of some points."""
    size, half = dr.opaque(mi.UInt32, rays), dr.opaque(mi.UInt32, rays // 2)
    lane = dr.arange(mi.UInt32, count * rays)
    path, row = lane % size, dr.opaque(mi.UInt32, start) + lane // size
    at_seed, stream = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), dr.gather(mi.UInt32, streams, row)
    rng = random_streams(at_seed, stream, path)
    # Two halves, each with a lattice of its own.
    shift = random_streams(at_seed, stream, LATTICE_STREAM + path // half)
    d = mi.warp.square_to_uniform_sphere(stratified(shift, path % half, half)[1])
    ray = mi.Ray3f(dr.gather(mi.Point3f, place, row), d)
    return ray_ends(scene.mi, ray, mi.Spectrum(1), rng), d
