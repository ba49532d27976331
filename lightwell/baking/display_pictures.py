"""Path-traced pictures without noise: those of the page, and the scored views, denoised and enlarged for display.

Of the figures, FLIP alone is measured against them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lightwell.baking.reference_budget import PICTURE_SCALE
from lightwell.core.denoise import denoise, missing
from lightwell.scenes.posing import posed
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable
from lightwell.transport import Query, SurfacePoints
from lightwell.transport.camera import gbuffer, guide_images, total_image
from lightwell.transport.moved import at_pose
from lightwell.transport.queries import make_query

if TYPE_CHECKING:
    from lightwell.baking.reference import ViewReference

# Added to reflectance before radiance is divided by it, so that black materials stay finite.
LEAST_REFLECTANCE = 0.05
# Neighbours whose normal differs count by this power of the cosine.
NORMAL_POWER = 8
# Share of its weight that a neighbour on another surface keeps, for pixels that have no other.
OTHER_SURFACE = 1e-4


def reference_picture(
    scene: Scene,
    camera: Camera,
    light: np.ndarray,
    variable: Variable | None,
    view_size: tuple[int, int],
    spp: int,
    seed: int,
    *,
    intensity: float,
    color: tuple[float, float, float],
    with_static: bool,
    more: Sequence[tuple[np.ndarray, Variable, float, tuple[float, float, float]]] = (),
) -> np.ndarray:
    """Path-trace a picture for display and remove its noise where a denoiser is installed.

    Args:
        scene: Scene to look at.
        camera: Pinhole camera.
        light: [3] position of the declared light (direction to the sun).
        variable: What the declared light is; None: there is none.
        view_size: Width and height of the scored views, pixels; the picture is ``PICTURE_SCALE`` times as large.
        spp: Paths per pixel.
        seed: Seed of the sampler.
        intensity: Candela (lux) of the declared light.
        color: Linear RGB of the declared light.
        with_static: Let the emitters of the scene shine too.
        more: Further lights: place [3], what they are, candela (lux) and colour.

    Returns:
        [H, W, 3] float32 linear radiance.
    """
    width, height = (PICTURE_SCALE * edge for edge in view_size)
    picture = total_image(
        scene,
        camera,
        light,
        variable,
        width,
        height,
        spp,
        seed,
        intensity=intensity,
        color=color,
        with_static=with_static,
    )
    for place, other, candela, tint in more:
        further = total_image(scene, camera, place, other, width, height, spp, seed, intensity=candela, color=tint)
        picture = picture + further
    return picture if missing() else denoise(picture, *guide_images(scene, camera, width, height))


@dataclass(frozen=True)
class DisplayView:
    """A scored view for display, ``PICTURE_SCALE`` times as large: N points at its pixel centres."""

    points: SurfacePoints
    seen: np.ndarray
    """[N] pixels of the points, row-major; the other pixels show no surface."""
    reference: np.ndarray
    """[H, W, 3] radiance of the reference, denoised where a denoiser is installed."""
    shape: np.ndarray
    """[h, w] index of the mesh at each pixel of the scored view; -1 where there is no surface."""
    position: np.ndarray
    """[h, w, 3] metres."""

    def picture(self, values: np.ndarray) -> np.ndarray:
        """Arrange values at the points as a picture.

        Args:
            values: [N, 3] values.

        Returns:
            [H, W, 3], 0 where there is no surface.
        """
        full = np.zeros_like(self.reference).reshape(-1, 3)
        full[self.seen] = values
        return full.reshape(self.reference.shape)


def display_view(scene: Scene, camera: Camera, view: ViewReference, size: tuple[int, int]) -> DisplayView:
    """Denoise the reference of a scored view, and enlarge it along the edges of surfaces.

    The light of a pixel, without its reflectance, is interpolated between the pixels of the scored view that lie on the
    same surface, and multiplied by the reflectance of the pixel.

    Args:
        scene: Scene to look at.
        camera: Camera of the view.
        view: The traced view.
        size: Width and height of the scored view, pixels.

    Returns:
        The view for display.

    Reference: Kopf, Cohen, Lischinski, Uyttendaele, *Joint Bilateral Upsampling*, SIGGRAPH 2007.
    """
    large = (PICTURE_SCALE * size[0], PICTURE_SCALE * size[1])
    # The view is in one pose, where something moves.
    pose = None if view.points.pose is None or not len(view.points) else view.points.pose[0]
    points, mask, _ = gbuffer(scene if pose is None else posed(scene, pose), camera, *large)
    points = points if pose is None else at_pose(points, pose)
    seen = np.flatnonzero(mask)
    points = points[seen]
    low, high = (make_query(scene, at, np.zeros(3, np.float32)) for at in (view.points, points))
    image = SeenPixels(view.seen, (size[1], size[0]))
    light = image(denoised(scene, view, size)) / (image(low.reflectance) + LEAST_REFLECTANCE)
    reference = np.zeros((large[1] * large[0], 3), np.float32)
    # The width of a pixel of the scored view over its distance.
    pixel = 2 * np.tan(np.radians(camera.fov_y) / 2) / size[1]
    span = pixel * np.linalg.norm(high.position - np.asarray(camera.position), axis=-1)
    between = upsample(light, image, low, high, seen, span)
    reference[seen] = between * (high.reflectance + LEAST_REFLECTANCE)
    shape = image(view.points.shape[:, None] + 1).astype(np.int32)[..., 0] - 1
    return DisplayView(points, seen, reference.reshape(large[1], large[0], 3), shape, image(low.position))


def denoised(scene: Scene, view: ViewReference, size: tuple[int, int]) -> np.ndarray:
    """Remove the noise of the reference of a scored view where a denoiser is installed.

    Args:
        scene: Scene to look at.
        view: The traced view.
        size: Width and height of the view, pixels.

    Returns:
        [N, 3] radiance at the points of the view.
    """
    noisy = np.nan_to_num(0.5 * (view.half_a + view.half_b))
    if missing() or not len(view.points):
        return noisy
    query = make_query(scene, view.points, np.zeros(3, np.float32))
    image = SeenPixels(view.seen, (size[1], size[0]))
    clean = denoise(image(noisy), image(np.clip(query.reflectance, 0, 1)), image(query.shading_normal))
    return clean.reshape(-1, 3)[view.seen]


@dataclass(frozen=True)
class SeenPixels:
    """The pixels of a picture that show a surface."""

    seen: np.ndarray
    """[N] row-major."""
    shape: tuple[int, int]
    """Height and width of the picture."""

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Arrange values at the pixels as a picture.

        Args:
            values: [N, C] values.

        Returns:
            [h, w, C] float32, 0 where there is no surface.
        """
        full = np.zeros((self.shape[0] * self.shape[1], values.shape[-1]), np.float32)
        full[self.seen] = values
        return full.reshape(*self.shape, -1)


def upsample(
    light: np.ndarray, image: SeenPixels, low: Query, high: Query, seen: np.ndarray, span: np.ndarray
) -> np.ndarray:
    """Interpolate light at the pixels of the enlarged picture, between the four pixels around each, by surface.

    Args:
        light: [h, w, 3] light of the small picture.
        image: Its pixels that show a surface.
        low: Positions and normals at these.
        high: Positions and normals at N pixels of the enlarged picture.
        seen: [N] these pixels, row-major.
        span: [N] distance on the surface that counts as another one: the width of a small pixel there, metres.

    Returns:
        [N, 3] light.
    """
    height, width = image.shape
    position, normal, on = image(low.position), image(low.normal), image(np.ones((len(image.seen), 1)))
    y = (seen // (PICTURE_SCALE * width) + 0.5) / PICTURE_SCALE - 0.5
    x = (seen % (PICTURE_SCALE * width) + 0.5) / PICTURE_SCALE - 0.5
    total, weights = np.zeros((len(seen), 3)), np.zeros((len(seen), 1))
    for down in (0, 1):
        for right in (0, 1):
            row, column = np.floor(y).astype(int) + down, np.floor(x).astype(int) + right
            near = (1 - np.abs(y - row)) * (1 - np.abs(x - column))
            at = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
            apart = ((position[at] - high.position) * high.normal).sum(axis=-1) / span
            facing = np.clip((normal[at] * high.normal).sum(axis=-1), 0, 1) ** NORMAL_POWER
            weight = (near * (facing * np.exp(-(apart**2)) + OTHER_SURFACE) * on[at][:, 0])[:, None]
            total += weight * light[at]
            weights += weight
    return total / np.maximum(weights, 1e-12)
