"""Procedural textures: brick, plaster, tiles, wood, cloth and three small paintings, encoded as PNG.

Every pattern is periodic (except the paintings), is generated from a fixed seed and has 512 x 512 pixels. Colours are
given and mixed in sRGB, [0, 1].
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import cache

import numpy as np
from PIL import Image as PillowImage

from ..scene import Image

SIZE = 512
Color = Sequence[float]


def encode(name: str, pixels: np.ndarray) -> Image:
    """Encode an image as 8-bit PNG.

    Args:
        name: Name of the image.
        pixels: [H, W, 3] sRGB values in [0, 1].

    Returns:
        The image.
    """
    stored = PillowImage.fromarray(np.round(np.clip(pixels, 0, 1) * 255).astype(np.uint8))
    stream = io.BytesIO()
    stored.save(stream, "PNG", compress_level=6)
    return Image(name, stream.getvalue(), "image/png")


def noise(seed: int, exponent: float = 1.5, stretch: tuple[float, float] = (1, 1), shortest: float = 3) -> np.ndarray:
    """Make periodic noise with amplitude 1/f^exponent, mean 0 and standard deviation 1.

    Waves shorter than ``shortest`` are left out: they would alias.

    Args:
        seed: Seed of the noise.
        exponent: Exponent of the spectrum.
        stretch: Scale of the waves along v and u.
        shortest: Shortest wavelength, pixels.

    Returns:
        [SIZE, SIZE] float64.
    """
    fy, fx = np.meshgrid(np.fft.fftfreq(SIZE), np.fft.rfftfreq(SIZE), indexing="ij")
    frequency = np.hypot(fy * stretch[0], fx * stretch[1]) * SIZE
    amplitude = np.where(frequency > 0, np.maximum(frequency, 1e-9) ** -exponent, 0)
    amplitude *= np.hypot(fy, fx) < 1 / shortest
    phase = np.fft.rfft2(np.random.default_rng(seed).standard_normal((SIZE, SIZE)))
    field = np.fft.irfft2(phase * amplitude, s=(SIZE, SIZE))
    return (field - field.mean()) / field.std()


def _mix(a: np.ndarray | Color, b: np.ndarray | Color, t: np.ndarray) -> np.ndarray:
    """Compute a + (b - a) t with t [H, W]."""
    return np.asarray(a) + (np.asarray(b) - np.asarray(a)) * t[..., None]


def _smooth(x: np.ndarray, low: float, high: float) -> np.ndarray:
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def _pixel_uv() -> tuple[np.ndarray, np.ndarray]:
    """Compute u and v [SIZE, SIZE] in [0, 1) at the pixel centres."""
    v, u = np.mgrid[0:SIZE, 0:SIZE]
    return (u + 0.5) / SIZE, (v + 0.5) / SIZE


def _sampled(field: np.ndarray, du: np.ndarray, dv: np.ndarray) -> np.ndarray:
    """Displace ``field`` by whole pixels (du, dv), cyclic."""
    v, u = np.mgrid[0:SIZE, 0:SIZE]
    return field[(v + np.round(dv).astype(int)) % SIZE, (u + np.round(du).astype(int)) % SIZE]


# Bricks across and courses per repeat; a repeat is BRICK_TILE metres wide and high.
BRICKS, COURSES, BRICK_TILE = 6, 18, 1.44


def _brick_layout(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Compute height (0 mortar, 1 brick) and a number in [0, 1) per brick, both [SIZE, SIZE]."""
    u, v = _pixel_uv()
    u = u + 0.0012 * noise(seed, 1.8)
    v = v + 0.0008 * noise(seed + 1, 1.8)
    course = np.floor(v * COURSES)
    along = u * BRICKS + 0.5 * (course % 2)
    tone = np.random.default_rng(seed).random((COURSES, BRICKS))
    tone = tone[course.astype(int) % COURSES, np.floor(along).astype(int) % BRICKS]
    # Distance to the joint's middle, metres.
    du = np.abs(along - np.round(along)) * BRICK_TILE / BRICKS
    dv = np.abs(v * COURSES - np.round(v * COURSES)) * BRICK_TILE / COURSES
    return _smooth(np.minimum(du, dv) + 0.0007 * noise(seed + 2, 0.8), 0.0035, 0.0095), tone


@cache
def brick(dark: Color, light: Color, mortar: Color, seed: int = 11) -> Image:
    """Make bricks in running bond; each has its own tone.

    Args:
        dark: Darkest brick, sRGB.
        light: Lightest brick, sRGB.
        mortar: Colour of the joints, sRGB.
        seed: Seed of the pattern.

    Returns:
        The image.
    """
    height, tone = _brick_layout(seed)
    stain = 0.5 + 0.18 * noise(seed + 3, 1.1) + 0.12 * noise(seed + 4, 0.5)
    clay = _mix(dark, light, np.clip(0.55 * tone + 0.45 * stain, 0, 1))
    clay *= 1 + 0.035 * noise(seed + 5, 0.4)[..., None]
    joint = np.asarray(mortar) * (0.94 + 0.04 * noise(seed + 6, 0.6)[..., None])
    return encode("brick", _mix(joint, clay, height))


@cache
def brick_normals(seed: int = 11, depth: float = 0.004) -> Image:
    """Make the tangent-space normal map of ``brick`` (+X right, +Y up).

    Args:
        seed: Seed of the bricks.
        depth: Depth of the joints, metres.

    Returns:
        The image.
    """
    height, _ = _brick_layout(seed)
    relief = depth * (height + 0.10 * noise(seed + 7, 0.9) * height) * SIZE / BRICK_TILE
    du = (np.roll(relief, -1, 1) - np.roll(relief, 1, 1)) / 2
    dv = (np.roll(relief, -1, 0) - np.roll(relief, 1, 0)) / 2
    normal = np.stack([-du, dv, np.ones_like(du)], axis=-1)
    return encode("brick_normals", 0.5 + 0.5 * normal / np.linalg.norm(normal, axis=-1, keepdims=True))


@cache
def plaster(color: Color, seed: int = 21, contrast: float = 1.0) -> Image:
    """Make trowelled plaster: soft clouds, short strokes, fine grain.

    Args:
        color: Mean colour, sRGB.
        seed: Seed of the pattern.
        contrast: Scale of the variation.

    Returns:
        The image.
    """
    cloud, stroke, grain = noise(seed, 1.9), noise(seed + 1, 1.4, (2.5, 0.8)), noise(seed + 2, 0.3)
    stroke = _sampled(stroke, 9 * cloud, 14 * noise(seed + 3, 1.9))
    shade = 1 + contrast * (0.022 * cloud + 0.016 * stroke + 0.008 * grain)
    return encode("plaster", np.asarray(color) * shade[..., None])


# Tiles per repeat along u and v; a repeat is TILES_SIZE metres.
TILES, TILES_SIZE = 3, 2.4


def _tile_layout(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Compute 1 on a tile and 0 in a joint, and a number in [0, 1) per tile, both [SIZE, SIZE]."""
    u, v = _pixel_uv()
    tone = np.random.default_rng(seed).random((TILES, TILES))
    tone = tone[(v * TILES).astype(int) % TILES, (u * TILES).astype(int) % TILES]
    joint = np.minimum(np.abs(u * TILES - np.round(u * TILES)), np.abs(v * TILES - np.round(v * TILES)))
    return _smooth(joint * TILES_SIZE / TILES, 0.0015, 0.0075), tone


@cache
def concrete_tiles(color: Color, joint: Color, seed: int = 31) -> Image:
    """Make large polished concrete tiles with narrow joints.

    Args:
        color: Mean colour of the tiles, sRGB.
        joint: Colour of the joints, sRGB.
        seed: Seed of the pattern.

    Returns:
        The image.
    """
    on, tone = _tile_layout(seed)
    cloud = _sampled(noise(seed + 1, 1.7), 160 * tone, 230 * tone)
    shade = 1 + 0.06 * (tone - 0.5) + 0.045 * cloud + 0.018 * noise(seed + 2, 0.5)
    return encode("concrete_tiles", _mix(joint, np.asarray(color) * shade[..., None], on))


@cache
def concrete_tiles_roughness(smooth: float, rough: float, seed: int = 31) -> Image:
    """Make the metallic-roughness map of ``concrete_tiles``: G is roughness, B is 0.

    Args:
        smooth: Least roughness of the tiles.
        rough: Largest roughness of the tiles; joints are rougher.
        seed: Seed of the tiles.

    Returns:
        The image.
    """
    on, tone = _tile_layout(seed)
    wear = _smooth(_sampled(noise(seed + 4, 1.6), 200 * tone, 90 * tone), -2, 2)
    green = np.where(on > 0.5, smooth + (rough - smooth) * wear, 0.6)
    return encode("concrete_tiles_roughness", np.stack([0 * green, green, 0 * green], axis=-1))


@cache
def wood(dark: Color, light: Color, planks: int = 0, seed: int = 41) -> Image:
    """Make wood with the grain along u.

    Args:
        dark: Colour of the grain, sRGB.
        light: Colour between the grain, sRGB.
        planks: Boards per repeat with dark gaps; 0: a single piece.
        seed: Seed of the pattern.

    Returns:
        The image.
    """
    _, v = _pixel_uv()
    count = max(planks, 1)
    board = np.floor(v * count).astype(int)
    tone = np.random.default_rng(seed).random(count)[board % count] if planks else 0.5 + 0 * v
    slow = _sampled(noise(seed, 2.0, (1, 6)), 170 * tone * count, 0 * tone)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (8 * v + 0.9 * slow) + 9 * tone)
    fibre = noise(seed + 1, 0.7, (0.7, 14), shortest=2)
    fibre = _sampled(fibre, 300 * tone, 0 * tone)
    pigment = np.clip(0.5 + 0.24 * (rings - 0.5) + 0.13 * fibre + 0.12 * slow + 0.42 * (tone - 0.5), 0, 1)
    pixels = _mix(light, dark, pigment)
    if planks:
        gap = np.abs(v * count - np.round(v * count)) / count
        pixels *= (0.45 + 0.55 * _smooth(gap, 0.0008, 0.004))[..., None]
    return encode("wood", pixels)


@cache
def cloth(color: Color, seed: int = 51, threads: int = 64, stripe: Color | None = None) -> Image:
    """Make a plain weave, with an optional stripe across u.

    Args:
        color: Colour of the threads, sRGB.
        seed: Seed of the pattern.
        threads: Threads per repeat in each direction.
        stripe: Colour of the stripe, sRGB; None: no stripe.

    Returns:
        The image.
    """
    u, v = _pixel_uv()
    over = (np.floor(u * threads) + np.floor(v * threads)) % 2
    thread = np.abs(np.sin(np.pi * np.where(over > 0, u, v) * threads))
    yarn = noise(seed, 0.5, (1, 8)) * over + noise(seed + 1, 0.5, (8, 1)) * (1 - over)
    shade = 0.82 + 0.18 * thread + 0.03 * yarn + 0.025 * noise(seed + 2, 1.5)
    pixels = np.asarray(color) * np.ones((SIZE, SIZE, 1))
    if stripe is not None:
        pixels = _mix(pixels, stripe, ((u * 8) % 1 < 0.14).astype(float))
    return encode("cloth", pixels * shade[..., None])


@cache
def leaf_blade(color: Color, rib: Color, seed: int = 61) -> Image:
    """Make the surface of a leaf: veins across u, a rib along v = 0 (and every whole v).

    Args:
        color: Colour of the blade, sRGB.
        rib: Colour of the rib, sRGB.
        seed: Seed of the pattern.

    Returns:
        The image.
    """
    u, v = _pixel_uv()
    fold = np.abs(v - np.round(v))
    vein = np.sin(2 * np.pi * (24 * u - 10 * fold)) ** 8
    shade = 1 + 0.06 * noise(seed, 1.4) + 0.10 * vein
    return encode("leaf_blade", _mix(np.asarray(color) * shade[..., None], rib, _smooth(-fold, -0.03, -0.008)))


@cache
def painting(kind: str, paper: Color, inks: tuple[Color, ...], seed: int = 71) -> Image:
    """Make a small abstract print.

    Args:
        kind: 'sun', 'hills' or 'arches'.
        paper: Colour of the paper, sRGB.
        inks: Colours of the shapes, sRGB.
        seed: Seed of the grain.

    Returns:
        The image.
    """
    u, v = _pixel_uv()
    pixels = np.asarray(paper) * np.ones((SIZE, SIZE, 1))
    for shape, ink in zip(_SHAPES[kind](u, v), inks):
        pixels = _mix(pixels, ink, _smooth(shape, -0.002, 0.002) * 0.96)
    inside = np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v))
    pixels = _mix(paper, pixels, _smooth(inside, 0.088, 0.092))
    return encode(f"painting_{kind}", pixels * (1 + 0.02 * noise(seed, 0.7)[..., None]))


def _sun(u: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    disc = 0.20 - np.hypot(u - 0.56, v - 0.38)
    return [disc, v - 0.66 - 0.03 * np.sin(7 * u), v - 0.80 - 0.05 * np.sin(4 * u + 1)]


def _hills(u: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    waves = [(0.34, 0.08, 5.0, 0.4), (0.50, 0.07, 6.3, 2.2), (0.64, 0.06, 4.4, 4.0), (0.78, 0.05, 7.1, 1.2)]
    return [v - y - a * np.sin(f * u + p) for y, a, f, p in waves]


def _arches(u: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    reach = np.where(v < 0.5, np.hypot(u - 0.5, v - 0.5), np.abs(u - 0.5))
    rings = [0.34 - reach, 0.26 - reach, 0.18 - reach, 0.10 - reach]
    return [np.minimum(r, 0.85 - v) for r in rings]


_SHAPES = {"sun": _sun, "hills": _hills, "arches": _arches}
