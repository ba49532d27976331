"""Aperture shapes on the unit disc: round, polygonal, drawn.

An aperture gives the transmission at lens coordinates u = (u_x, u_y), |u| <= 1, in image axes (x right, y down).
Light of a point with signed circle of confusion s that passes the lens at u lands at s·u, so that the shape appears
mirrored through its centre in front of the focus distance, where s < 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightwell.lens.errors import LensError

# Names of regular polygons on the command line, and their number of sides.
POLYGONS = {"triangle": 3, "square": 4, "pentagon": 5, "hexagon": 6, "heptagon": 7, "octagon": 8}
# Resolution to which drawn masks are reduced; a PSF of 64 px radius is 129 px wide.
MASK_SIZE = 256


@dataclass(frozen=True)
class Aperture:
    """Shape of a lens opening."""

    kind: str = "disc"
    """``disc``, ``polygon``, ``mask`` or ``cats-eye``."""
    blades: int = 0
    """Number of sides of a polygon."""
    angle: float = 0.0
    """Rotation of a polygon, degrees from the x axis towards y (downwards)."""
    mask: tuple[bytes, int] | None = None
    """Drawn mask: float32 bytes of a square picture and its size; the unit disc touches its sides."""
    label: str = ""
    """Key of a mask whose picture is not available, as read from a library."""

    @property
    def round(self) -> bool:
        """Whether the shape is the same at every rotation."""
        return self.kind == "disc"

    def key(self) -> str:
        """Return a text that identifies the shape; part of the names of cached libraries.

        Returns:
            For example ``disc``, ``polygon-6-15`` or ``mask-`` and a hash of the picture.
        """
        if self.label:
            return self.label
        if self.kind == "mask":
            import hashlib

            return "mask-" + hashlib.sha256(self._mask[0]).hexdigest()[:16]
        return "disc" if self.kind == "disc" else f"polygon-{self.blades}-{self.angle:g}"

    def __call__(self, ux: np.ndarray, uy: np.ndarray) -> np.ndarray:
        """Evaluate the transmission.

        Args:
            ux: Lens coordinate x, any shape; the disc is |u| <= 1.
            uy: Lens coordinate y, same shape.

        Returns:
            Transmission in [0, 1], same shape.
        """
        if self.kind == "disc":
            return (ux * ux + uy * uy <= 1.0).astype(np.float64)
        if self.kind == "polygon":
            return _polygon(ux, uy, self.blades, np.deg2rad(self.angle))
        return _sample_mask(self._picture(), ux, uy)

    @property
    def _mask(self) -> tuple[bytes, int]:
        if self.mask is None:
            raise LensError("lens: an aperture of kind mask has no picture; give it with --aperture")
        return self.mask

    def _picture(self) -> np.ndarray:
        data, size = self._mask
        if not size:
            raise LensError(f"lens: a library of {self.label} lacks a node; give the picture with --aperture")
        return np.frombuffer(data, np.float32).reshape(size, size)


DISC = Aperture()


def _polygon(ux: np.ndarray, uy: np.ndarray, blades: int, angle: float) -> np.ndarray:
    """Return 1 inside the regular polygon whose corners lie on the unit circle, 0 outside."""
    inside = np.ones(np.broadcast(ux, uy).shape, bool)
    apothem = np.cos(np.pi / blades)
    for k in range(blades):
        side = angle + (2 * k + 1) * np.pi / blades
        inside &= ux * np.cos(side) + uy * np.sin(side) <= apothem
    return inside.astype(np.float64)


def _sample_mask(picture: np.ndarray, ux: np.ndarray, uy: np.ndarray) -> np.ndarray:
    """Interpolate a mask bilinearly; 0 outside the picture."""
    from scipy.ndimage import map_coordinates

    size = picture.shape[0]
    rows, columns = ((u + 1) * 0.5 * size - 0.5 for u in (uy, ux))
    return map_coordinates(picture, np.broadcast_arrays(rows, columns), order=1, mode="constant", cval=0.0)


def polygon(blades: int, angle: float = 0.0) -> Aperture:
    """Make a regular polygonal opening.

    Args:
        blades: Number of sides, 3 to 64.
        angle: Rotation from the x axis towards y (downwards), degrees.

    Returns:
        The aperture.

    Raises:
        LensError: ``blades`` is out of range.
    """
    if not 3 <= blades <= 64:
        raise LensError(f"lens: an aperture of {blades} blades; use 3 to 64, or disc")
    return Aperture("polygon", int(blades), float(angle) % (360.0 / blades))


def from_picture(luminance: np.ndarray, centre: str = "centroid", where: str = "mask") -> Aperture:
    """Make an aperture from a drawn mask.

    The picture is cropped to the smallest square about its centre that holds all open pixels, so that the unit disc
    touches the outermost open one, and area-averaged to ``MASK_SIZE``.

    Args:
        luminance: Mask [height, width], ≥ 0, in any range: 0 is closed, the largest value fully open.
        centre: ``centroid`` (of the open pixels) or ``picture`` (centre of the picture).
        where: Name of the mask, for messages.

    Returns:
        The aperture.

    Raises:
        LensError: The mask is not one finite channel ≥ 0, or is black everywhere.
    """
    picture = np.asarray(luminance, np.float64)
    if picture.ndim != 2 or not np.isfinite(picture).all() or picture.min() < 0:
        raise LensError(f"lens: aperture {where} must be one channel of finite values >= 0; save it as a grey PNG")
    if picture.max() <= 0:
        raise LensError(f"lens: aperture {where} is black everywhere, no light would pass; draw the opening in white")
    picture = picture / picture.max()
    rows, columns = np.indices(picture.shape) + 0.5
    if centre == "centroid":
        cy, cx = (float((picture * axis).sum() / picture.sum()) for axis in (rows, columns))
    else:
        cy, cx = picture.shape[0] / 2, picture.shape[1] / 2
    open_ = picture > 1 / 255
    reach = float(np.hypot(rows - cy, columns - cx)[open_].max()) + 0.5
    fine = 4
    step = 2 * reach / (MASK_SIZE * fine)
    from scipy.ndimage import map_coordinates

    at = (np.arange(MASK_SIZE * fine) + 0.5) * step - reach
    sampled = map_coordinates(
        picture, np.meshgrid(cy - 0.5 + at, cx - 0.5 + at, indexing="ij"), order=1, mode="constant", cval=0.0
    )
    small = sampled.reshape(MASK_SIZE, fine, MASK_SIZE, fine).mean((1, 3)).astype(np.float32)
    return Aperture("mask", mask=(small.tobytes(), MASK_SIZE))


def read_mask(path: str | Path) -> Aperture:
    """Read an aperture drawn as a picture: its luminance times its opacity.

    Args:
        path: PNG or another format that Pillow reads, up to 16384 pixels a side.

    Returns:
        The aperture.

    Raises:
        LensError: The file is missing, damaged or too large.
    """
    from PIL import Image

    from lightwell.core.image_io import eight_bits

    try:
        with Image.open(path) as image:
            if max(image.size) > 16384:
                raise LensError(
                    f"lens: aperture {path} is {image.size[0]}x{image.size[1]}; 16384 pixels a side at most"
                )
            pixels = np.asarray(eight_bits(image).convert("LA"), np.float64) / 255
    except FileNotFoundError:
        raise LensError(f"lens: no aperture picture {path}; give disc, hexagon … or an existing PNG") from None
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        reason = " ".join(str(error).split())
        raise LensError(f"lens: cannot read aperture {path} ({reason}); give disc, hexagon … or a PNG") from None
    return from_picture(pixels[..., 0] * pixels[..., 1], where=str(path))


def picture_of(text: str) -> list[tuple[str, str]]:
    """Find the file that an ``--aperture`` names.

    Args:
        text: ``disc``, the name of a polygon (``POLYGONS``), or the path of a picture.

    Returns:
        The option and the path; nothing for a shape without a picture.
    """
    return [] if text == "disc" or text in POLYGONS else [("--aperture", text)]


def parse(text: str, blades: int | None = None, angle: float = 0.0) -> Aperture:
    """Parse the aperture options of the command line.

    Args:
        text: ``disc``, the name of a polygon (``POLYGONS``), or the path of a picture.
        blades: Number of sides of a polygon, 3 to 64, where ``text`` is ``disc``; None: as ``text`` says.
        angle: Rotation of a polygon, degrees.

    Returns:
        The aperture.

    Raises:
        LensError: The options contradict each other, ``blades`` is out of range, or the picture cannot be read.
    """
    if blades is not None and text != "disc" and POLYGONS.get(text) != blades:
        raise LensError(f"lens: --aperture {text} has no {blades} blades; leave out --aperture or --blades")
    if angle and blades is None and text not in POLYGONS:
        raise LensError(
            f"lens: --blade-angle {angle:g} turns polygons, not --aperture {text}; leave it out, or add --blades N"
        )
    if blades is not None:
        return polygon(blades, angle)
    if text == "disc":
        return DISC
    if text in POLYGONS:
        return polygon(POLYGONS[text], angle)
    return read_mask(text)
