"""Inputs of the lens benchmark: synthetic frames, and Mitsuba scenes with their physical reference.

The reference averages static thin-lens renders at jittered times, geometry moved between them by parameter update,
because shutter times have no effect in Mitsuba 3.9 and the wheel has no animated transform.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from lightwell.backend import mi
from lightwell.lens.camera import LensCamera
from lightwell.lens.samples import LensSamples
from lightwell.lens.thin_lens import View, trace, view

Transform = mi.ScalarTransform4f


def ramp(size: int = 384, largest: float = 24.0, highlights: float = 40.0, seed: int = 0):
    """Checker over a ramp of blur 0 … largest, a patch in focus and one at 14 px, 40 one-pixel highlights.

    Returns rgba [size, size, 4] and s [size, size].
    """
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size]
    checker = 0.15 + 0.7 * (((x // 16) + (y // 16)) % 2)
    rgb = checker[..., None] * (0.6 + 0.4 * rng.random((size // 16 + 1, size // 16 + 1, 3))[y // 16, x // 16])
    s = (x / (size - 1) * largest).astype(np.float32)
    s[size // 8 : size // 4, size // 8 : size // 3] = 0
    s[size // 2 : 3 * size // 4, size // 6 : size // 3] = 14
    at = rng.integers(0, size, (40, 2))
    if highlights:
        rgb[at[:, 0], at[:, 1]] = highlights
    return np.concatenate([rgb, np.ones((size, size, 1))], -1).astype(np.float32), s


@dataclass(frozen=True)
class Motion:
    """Where one shape goes while the shutter is open."""

    shape: str
    centre: np.ndarray
    """[3] at mid-shutter, metres"""
    travel: np.ndarray
    """[3] over the open shutter, metres"""


@dataclass
class Case:
    """A scene, its camera and what moves."""

    name: str
    scene: object
    pinhole: object
    seen: View
    motions: list[Motion]
    fov: float


# Camera of all scenes: horizontal field of view, aperture radius and focus in metres.
FOV, RADIUS, FOCUS = 50.0, 0.06, 3.0


def _sensor(kind: str, width: int, height: int) -> dict:
    sensor = {
        "type": kind,
        "fov": FOV,
        "fov_axis": "x",
        "near_clip": 0.001,
        "to_world": Transform().look_at([0, 0, 0], [0, 0, 1], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
    }
    return sensor | ({"aperture_radius": RADIUS, "focus_distance": FOCUS} if kind == "thinlens" else {})


def _wall(distance: float, scale: float, tiles: float) -> dict:
    texture = {
        "type": "checkerboard",
        "color0": {"type": "rgb", "value": [0.75, 0.7, 0.6]},
        "color1": {"type": "rgb", "value": [0.2, 0.25, 0.35]},
        "to_uv": Transform().scale([tiles, tiles, 1]),
    }
    return {
        "type": "rectangle",
        "to_world": Transform().translate([0, 0, distance]).scale(scale).rotate([0, 1, 0], 180),
        "emitter": {"type": "area", "radiance": texture},
    }


def _glow(colour, tiles: float) -> dict:
    """A checkered surface that shines by itself: nothing but the lens, the shutter and edges has noise."""
    texture = {
        "type": "checkerboard",
        "color0": {"type": "rgb", "value": [float(c) for c in colour]},
        "color1": {"type": "rgb", "value": [0.45 * float(c) for c in colour]},
        "to_uv": Transform().scale([tiles, tiles, 1]),
    }
    return {"type": "area", "radiance": texture}


def _base(kind: str, width: int, height: int) -> dict:
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 1},
        "sensor": _sensor(kind, width, height),
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.6, 0.65, 0.7]}},
    }


def cubes(width: int = 320, height: int = 200, moving: bool = True, seed: int = 3) -> Case:
    """Cubes at many depths before a wall; some fly by."""
    rng = np.random.default_rng(seed)
    parts, motions = {"wall": _wall(9.0, 9.0, 24)}, []
    for i in range(18):
        z = float(rng.choice([1.3, 1.9, 3.0, 4.5, 6.5]))
        centre = np.array([*(rng.uniform(-0.42, 0.42, 2) * z * [1, height / width]), z])
        colour = list(0.15 + 0.75 * rng.random(3))
        axis = rng.normal(size=3)
        axis = [float(v) for v in axis / np.linalg.norm(axis)]
        transform = Transform().translate(list(centre)).rotate(axis, float(rng.uniform(0, 360)))
        parts[f"cube{i}"] = {
            "type": "cube",
            "to_world": transform.scale(0.033 * z),
            "emitter": _glow(colour, 3),
        }
        if moving and i % 3 == 0:
            motions.append(Motion(f"cube{i}", centre, np.array([*(rng.uniform(-0.12, 0.12, 2) * z), 0.0])))
    return _case("cubes", parts, motions, width, height)


def fence(width: int = 320, height: int = 200) -> Case:
    """A fence near the lens before a textured wall in focus."""
    parts = {"wall": _wall(FOCUS, 3.0, 12)}
    for i in range(7):
        parts[f"bar{i}"] = {
            "type": "cube",
            "to_world": Transform().translate([-0.45 + 0.15 * i, 0, 1.2]).scale([0.022, 1.0, 0.01]),
            "emitter": _glow([0.75, 0.25, 0.1], 2),
        }
    return _case("fence", parts, [], width, height)


def _case(name: str, parts: dict, motions: list[Motion], width: int, height: int) -> Case:
    scene = mi.load_dict(_base("thinlens", width, height) | parts)
    pinhole = mi.load_dict(_base("perspective", width, height) | parts)
    return Case(name, scene, pinhole, view(scene), motions, FOV)


def _move(params, rest: dict, motions: list[Motion], t: float) -> None:
    """Shapes at time t of the open shutter, ½ is where they rest."""
    for motion in motions:
        key = f"{motion.shape}.vertex_positions"
        shift = (t - 0.5) * motion.travel
        params[key] = mi.Float((rest[key].reshape(-1, 3) + shift).ravel())
    if motions:
        params.update()


def reference(case: Case, times: int, spp: int, lens: bool = True, moving: bool = True) -> tuple[np.ndarray, float]:
    """Mean of ``times`` renders at stratified times, each with its own seed, and its own RMS standard error."""
    scene = case.scene if lens else case.pinhole
    params = mi.traverse(scene)
    rest = {f"{m.shape}.vertex_positions": np.array(params[f"{m.shape}.vertex_positions"]) for m in case.motions}
    rng = np.random.default_rng(17)
    total = square = 0.0
    for i in range(times):
        if moving:
            _move(params, rest, case.motions, (i + rng.random()) / times)
        picture = np.array(mi.render(scene, spp=spp, seed=1000 + i))[..., :3].astype(np.float64)
        total, square = total + picture, square + picture**2
    _move(params, rest, case.motions, 0.5)
    mean = total / times
    noise = float(np.sqrt(np.maximum(square / times - mean**2, 0).mean() / times))
    return mean, noise


def samples(case: Case, spp: int, seed: int, moving: bool) -> LensSamples:
    """``spp`` rays a pixel through the lens, one set per stratum of the shutter, with their motion in pixels."""
    if not moving:
        return trace(case.scene, spp, seed=seed)
    params = mi.traverse(case.scene)
    rest = {f"{m.shape}.vertex_positions": np.array(params[f"{m.shape}.vertex_positions"]) for m in case.motions}
    rng, sets = np.random.default_rng(seed), []
    names = [shape.id() for shape in case.scene.shapes()]
    focal = case.seen.width / (2 * np.tan(np.deg2rad(case.fov) / 2))
    # With one sample a pixel four strata of time share the pixels among them.
    strata = max(spp, 4)
    shuffled = rng.permutation(case.seen.width * case.seen.height)
    for i in range(strata):
        t = (i + rng.random()) / strata
        _move(params, rest, case.motions, t)
        rays = trace(case.scene, 1, seed=1000 * seed + i, time=t)
        motion = np.zeros((len(rays.x), 2), np.float32)
        for one in case.motions:
            hit = rays.shape == names.index(one.shape)
            motion[hit] = -focal * one.travel[:2] / rays.depth[hit][:, None]
        kept = slice(None) if spp >= strata else shuffled[i::strata]
        rays = replace(rays, motion=motion)
        sets.append([getattr(rays, f.name)[kept] for f in fields(rays)])
    _move(params, rest, case.motions, 0.5)
    return LensSamples(*(np.concatenate(parts) for parts in zip(*sets)))


def inputs(case: Case, spp: int = 256):
    """What the lens gets: rgb, camera-axis depth, motion per shutter, of the pinhole at mid-shutter.

    Depth and shape are those of the pixel's centre; motion is exact for translation.
    """
    rgb = np.array(mi.render(case.pinhole, spp=spp, seed=5))[..., :3]
    width, height = case.seen.width, case.seen.height
    y, x = np.mgrid[:height, :width]
    eye = case.pinhole.sensors()[0]
    at = mi.Point2f(mi.Float(((x + 0.5) / width).ravel()), mi.Float(((y + 0.5) / height).ravel()))
    ray, _ = eye.sample_ray(0.0, 0.5, at, mi.Point2f(0.5))
    found = case.pinhole.ray_intersect(ray)
    depth = np.where(np.array(found.is_valid()), np.array(found.p.z), np.inf).reshape(height, width)
    motion = _motion_of(case, found, depth, np.isfinite(depth))
    return rgb, depth, motion


def camera_of(case: Case) -> LensCamera:
    """The camera of the reference; motion is given per open shutter."""
    return case.seen.camera


def peel(case: Case, spp: int = 64) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second surfaces along the pinhole's rays: rgba (alpha 0 where there is none), depth and motion at centres."""
    width, height = case.seen.width, case.seen.height
    eye, rng = case.pinhole.sensors()[0], np.random.default_rng(23)
    y, x = np.mgrid[:height, :width]
    rgba = np.zeros((height, width, 4))
    for i in range(spp + 1):
        jitter = (0.5, 0.5) if i == spp else rng.random(2)
        at = mi.Point2f(mi.Float(((x + jitter[0]) / width).ravel()), mi.Float(((y + jitter[1]) / height).ravel()))
        ray, _ = eye.sample_ray(0.0, 0.5, at, mi.Point2f(0.5))
        first = case.pinhole.ray_intersect(ray)
        # Leave the first body altogether: the far side of a cube is not what lies behind it.
        second = first
        for _ in range(3):
            again = case.pinhole.ray_intersect(second.spawn_ray(ray.d), second.is_valid())
            inside = again.is_valid() & (again.shape == first.shape)
            second = again
            if not bool(np.array(inside).any()):
                break
        valid = np.array(second.is_valid() & (second.shape != first.shape)).reshape(height, width)
        if i == spp:
            depth = np.where(valid, np.array(second.p.z).reshape(height, width), np.inf)
            motion = _motion_of(case, second, depth, valid)
            break
        light = np.array(second.emitter(case.pinhole).eval(second)).T.reshape(height, width, 3)
        rgba[valid] += np.concatenate([light, np.ones((height, width, 1))], -1)[valid]
    return np.where(valid[..., None], rgba / np.maximum(rgba[..., 3:], 1), 0), depth, motion


def _motion_of(case: Case, found, depth, valid) -> np.ndarray:
    """Displacement in pixels of the shapes that rays found, over the open shutter."""
    focal = case.seen.width / (2 * np.tan(np.deg2rad(case.fov) / 2))
    motion = np.zeros((*depth.shape, 2), np.float32)
    shapes = {shape.id(): shape for shape in case.pinhole.shapes()}
    for one in case.motions:
        hit = valid & np.array(found.shape == mi.ShapePtr(shapes[one.shape])).reshape(depth.shape)
        # Camera space has +x to the left of the picture and +y up.
        motion[hit] = (-focal * one.travel[:2] / depth[hit][:, None]).astype(np.float32)
    return motion
