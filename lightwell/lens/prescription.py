"""Bokeh of a real lens: point spread functions by tracing rays through the surfaces of a prescription.

A prescription lists spherical surfaces from the scene to the sensor, in the text format that other renderers use: four
numbers a line, the radius of curvature (0: a plane), the distance to the next surface, the index of refraction behind
the surface (0 or 1: air), and the diameter, all lengths in millimetres. The stop is the plane between air and air.
Behind # are comments.

The lens is scaled to the camera's focal length, its stop to the f-number, and the sensor is moved until the focus
distance is sharp. So spherical aberration, coma, astigmatism, field curvature and the vignetting of all rims shape the
blur, per circle of confusion, side of the focus and distance from the middle of the picture. Light of one wavelength;
distortion and the fall-off of brightness towards the corners are left out, because the picture was rendered without.

Notation: z along the axis, in metres, light travels towards +z; the entrance pupil lies at z = 0.
Reference: Kolb, Mitchell, Hanrahan, *A Realistic Camera Model for Computer Graphics*, SIGGRAPH 1995.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from lightwell.lens import psf
from lightwell.lens.camera import LensCamera
from lightwell.lens.errors import LensError

# Surfaces of a prescription, and the largest file.
MOST_SURFACES, MOST_BYTES = 100, 1 << 16
# Rays along each axis of the pupil per pixel of radius, and their least and largest number.
RAYS_PER_PIXEL, FEWEST_RAYS, MOST_RAYS = 24, 128, 1024
# Rays start on a disc that is larger than the entrance pupil: off the axis the pupil moves and grows.
OVERSIZE = 1.3
# Share of the stop's radius within which rays count as near the chief ray.
NEAR_CHIEF = 0.3


@dataclass(frozen=True)
class Prescription:
    """Spherical surfaces from the scene to the sensor, K of them; lengths in metres."""

    curvature: np.ndarray
    """[K] one over the radius; 0 for planes."""
    thickness: np.ndarray
    """[K] distance to the next surface; the last one is not used."""
    index: np.ndarray
    """[K] index of refraction behind the surface."""
    radius: np.ndarray
    """[K] half the diameter."""
    stop: int
    """Number of the surface that is the stop."""
    name: str = "lens"
    """For messages."""

    # ------------------------------------------------------------------ close to the axis

    def paraxial(self, height: float, slope: float, last: int | None = None) -> tuple[float, float]:
        """Follow a ray close to the axis from the first surface.

        Args:
            height: Distance from the axis at the first surface, metres.
            slope: Change of the height per metre before it.
            last: Surface to stop at, before its refraction; None: behind the last one.

        Returns:
            Height there, and slope (before refraction, or behind the last surface).
        """
        before = 1.0
        for k in range(len(self.index)):
            if last is not None and k == last:
                return height, slope
            after = float(self.index[k])
            slope = (before * slope - height * (after - before) * float(self.curvature[k])) / after
            before = after
            if k + 1 < len(self.index):
                height += slope * float(self.thickness[k])
        return height, slope

    @cached_property
    def focal(self) -> float:
        """Compute the focal length.

        Returns:
            Metres, > 0.

        Raises:
            LensError: The lens does not focus.
        """
        _, slope = self.paraxial(1.0, 0.0)
        if slope >= 0:
            raise LensError(f"lens: {self.name} does not focus: its focal length is not above 0; check the signs")
        return -1 / slope

    @cached_property
    def pupil(self) -> tuple[float, float]:
        """Compute place and size of the entrance pupil.

        Returns:
            Distance behind the first surface, metres, and the pupil's radius over that of the stop.

        Raises:
            LensError: The pupil is at infinity.
        """
        # Rays through the middle of the stop: heights at the stop are linear in height and slope at the front.
        a, b = (self.paraxial(h, u, self.stop)[0] for h, u in ((1.0, 0.0), (0.0, 1.0)))
        if abs(a) < 1e-12:
            raise LensError(f"lens: {self.name} has its entrance pupil at infinity, which is not supported")
        return b / a, 1 / abs(a)

    def scaled(self, factor: float) -> Prescription:
        """Scale all lengths.

        Args:
            factor: Factor, > 0.

        Returns:
            The scaled lens.
        """
        lengths = {name: getattr(self, name) * factor for name in ("thickness", "radius")}
        return replace(self, curvature=self.curvature / factor, **lengths)

    # ------------------------------------------------------------------ rays

    def trace(self, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, ...]:
        """Trace rays through the lens; the first surface touches z = 0.

        Args:
            origin: [N, 3] points before the lens, metres.
            direction: [N, 3] unit directions, towards +z.

        Returns:
            Points on the last surface [N, 3], directions behind it [N, 3], places in the stop [N, 2], and whether a
            ray passed all rims [N].
        """
        p, d = np.array(origin, np.float64), np.array(direction, np.float64)
        alive, place = np.ones(len(p), bool), np.zeros((len(p), 2))
        z, before = 0.0, 1.0
        for k, (c, after, rim) in enumerate(zip(self.curvature, self.index, self.radius)):
            p, hit = _meet(p, d, z, float(c))
            alive &= hit & (p[:, 0] ** 2 + p[:, 1] ** 2 <= rim**2)
            if k == self.stop:
                place = p[:, :2].copy()
            if after != before:
                d, passed = _refract(p, d, z, float(c), before / float(after))
                alive &= passed
            z, before = z + float(self.thickness[k]), float(after)
        return p, d, place, alive

    def key(self) -> str:
        """Return a text that identifies the lens.

        Returns:
            A hash of all numbers.
        """
        numbers = np.concatenate([self.curvature, self.thickness[:-1], self.index, self.radius, [self.stop]])
        return hashlib.sha256(np.float64(numbers).tobytes()).hexdigest()[:16]


def _meet(p: np.ndarray, d: np.ndarray, z: float, curvature: float) -> tuple[np.ndarray, np.ndarray]:
    """Points [N, 3] where rays meet a spherical surface whose vertex lies at z, and whether they do [N]."""
    offset = p - [0.0, 0.0, z]
    # c t² (d·d) + 2 t (c o·d − d_z) + c o·o − 2 o_z = 0, solved without cancellation for planes too.
    half = d[:, 2] - curvature * np.einsum("ij,ij->i", offset, d)
    rest = curvature * np.einsum("ij,ij->i", offset, offset) - 2 * offset[:, 2]
    inside = half * half - curvature * rest
    hit = inside >= 0
    t = rest / (half + np.sign(half) * np.sqrt(np.where(hit, inside, 0)))
    return p + t[:, None] * d, hit & np.isfinite(t)


def _refract(
    p: np.ndarray, d: np.ndarray, z: float, curvature: float, ratio: float
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Directions [N, 3] behind a surface (Snell), and whether light passes [N]."""
    normal = np.array([0.0, 0.0, 1.0]) - curvature * (p - [0.0, 0.0, z])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", normal, d)
    inside = 1 - ratio**2 * (1 - cosine**2)
    passes = inside >= 0
    bent = ratio * d + (np.sqrt(np.where(passes, inside, 0)) - ratio * cosine)[:, None] * normal
    return bent, passes


@dataclass(frozen=True)
class MountedLens:
    """A prescription on a camera: its focal length, f-number, focus and sensor."""

    lens: Prescription
    """Scaled to the focal length, its stop to the f-number."""
    sensor: float
    """Distance of the sensor behind the last surface, metres."""
    pitch: float
    """Size of a pixel, metres."""
    half: float
    """Distance of a corner of the picture from its middle, metres on the sensor."""
    image: float
    """Distance of the image of a pinhole camera of the same field of view, metres."""
    focus: float
    """One over the focus distance, 1 / m."""

    def key(self) -> str:
        """Return a text that identifies the kernels, in the form of the key of a drawn aperture.

        Returns:
            ``mask-`` and a hash.
        """
        numbers = [self.sensor, self.pitch, self.half, self.image, self.focus]
        text = f"{self.lens.key()} " + " ".join(f"{value:.6g}" for value in numbers)
        return "mask-" + hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def strength(self) -> float:
        """Pixels by which the marginal ray of a point on the axis misses, times the distance of the point in metres."""
        lens, (depth, scale) = self.lens, self.lens.pupil
        edge = scale * float(lens.radius[lens.stop])
        # A ray from the edge of the pupil at slope u: the height at the sensor is linear in u.
        heights = []
        for slope in (0.0, 1.0):
            height, behind = lens.paraxial(edge - depth * slope, slope)
            heights.append(height + behind * self.sensor)
        return edge * abs(heights[1] - heights[0]) / self.pitch

    def kernel(self, s: float, field: float) -> np.ndarray:
        """Trace the light of one point.

        Args:
            s: Signed circle of confusion that the thin-lens camera gives the point, pixels; > 0 behind the focus.
            field: Distance of its picture from the middle, over that of the corners, in [0, 1]; it lies on +x.

        Returns:
            Point spread function [2·hy+1, 2·hx+1], sum 1; a pixel where no light passes.
        """
        offset = self.rays(s, field)
        if not len(offset):
            return np.ones((1, 1))
        half = int(np.ceil(np.abs(offset).max() + 1.5))
        place = (offset + half + 0.5) * psf.FINE - 0.5
        size = (2 * half + 1) * psf.FINE
        fine = np.zeros((size, size))
        low = np.floor(place).astype(int)
        part = place - low
        for dx, wx in ((0, 1 - part[:, 0]), (1, part[:, 0])):
            for dy, wy in ((0, 1 - part[:, 1]), (1, part[:, 1])):
                np.add.at(fine, (low[:, 1] + dy, low[:, 0] + dx), wx * wy)
        image = fine.reshape(2 * half + 1, psf.FINE, -1, psf.FINE).sum((1, 3))
        # The lens is symmetric about the plane of point and axis; light that no pixel shows is cut.
        image = image + image[::-1]
        image = np.where(image > 1e-6 * image.max(), image, 0.0)
        return psf.trim(image / image.sum())

    def rays(self, s: float, field: float) -> np.ndarray:
        """Trace rays of one point over a regular grid of its pupil.

        Args:
            s: Signed circle of confusion, pixels.
            field: Distance from the middle over that of the corners.

        Returns:
            [N, 2] where they land on the picture, pixels from the chief ray, x away from the middle, y down.
        """
        lens, (depth, scale) = self.lens, self.lens.pupil
        edge = scale * float(lens.radius[lens.stop])
        count = int(np.clip(RAYS_PER_PIXEL * abs(s), FEWEST_RAYS, MOST_RAYS))
        axis = OVERSIZE * edge * ((np.arange(count) + 0.5) / count * 2 - 1)
        x, y = (v.ravel() for v in np.meshgrid(axis, axis))
        within = x * x + y * y <= (OVERSIZE * edge) ** 2
        x, y = x[within], y[within]
        # From a point at distance 1/w in the direction of the field; w < 0 is light that converges already.
        w, tangent = self.focus - s / self.strength, field * self.half / self.image
        direction = np.column_stack([x * w - tangent, y * w, np.ones(len(x))])
        # From the pupil's plane back to a plane before the lens.
        start = min(0.0, -float(lens.radius[0])) - depth
        origin = np.column_stack([x, y, np.full(len(x), depth)]) + direction * start
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        p, d, place, alive = lens.trace(origin, direction)
        if not alive.any():
            return np.zeros((0, 2))
        p, d, place = p[alive], d[alive], place[alive]
        behind = float(np.sum(lens.thickness[:-1])) + self.sensor
        landed = p[:, :2] + d[:, :2] * ((behind - p[:, 2]) / d[:, 2])[:, None]
        # The picture of a lens is upside down.
        return -(landed - _chief(landed, place, float(lens.radius[lens.stop]))) / self.pitch


def _chief(landed: np.ndarray, place: np.ndarray, radius: float) -> np.ndarray:
    """[2] where the ray through the middle of the stop lands: a linear fit to the rays near it."""
    near = np.hypot(place[:, 0], place[:, 1]) < NEAR_CHIEF * radius
    if near.sum() < 8:
        return landed.mean(axis=0)
    terms = np.column_stack([np.ones(near.sum()), place[near]])
    return np.linalg.lstsq(terms, landed[near], rcond=None)[0][0]


def mount(lens: Prescription, camera: LensCamera, width: int, height: int) -> MountedLens:
    """Put a lens on a camera: scale it, close its stop, and focus.

    Args:
        lens: The prescription.
        camera: Focal length, f-number, focus distance and width of the sensor.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.

    Returns:
        The mounted lens.

    Raises:
        LensError: The lens does not open so wide.
    """
    lens = lens.scaled(camera.focal / lens.focal)
    scale = lens.pupil[1]
    opening = camera.focal / camera.fstop / 2 / scale
    widest = float(lens.radius[lens.stop])
    # A thousandth is rounding of printed diameters.
    if opening > 1.001 * widest:
        raise LensError(
            f"lens: {lens.name} opens to f/{camera.focal / (2 * scale * widest):.2f} only; "
            f"give --fstop of at least that, not {camera.fstop:g}"
        )
    radius = lens.radius.copy()
    radius[lens.stop] = opening
    lens = replace(lens, radius=radius)
    focus = 1 / camera.focus
    pitch = camera.sensor / width
    image = camera.focal if np.isinf(camera.focus) else camera.focal * camera.focus / (camera.focus - camera.focal)
    return MountedLens(lens, _sensor(lens, focus), pitch, pitch * np.hypot(width, height) / 2, image, focus)


def _sensor(lens: Prescription, focus: float) -> float:
    """Distance behind the last surface at which a point on the axis at 1/``focus`` before the pupil is sharp."""
    depth, _ = lens.pupil
    height, slope = lens.paraxial(1.0 - depth * focus, focus)
    if slope >= 0:
        raise LensError(f"lens: {lens.name} forms no picture of so near a point; focus farther away")
    return -height / slope


def read(path: str | Path) -> Prescription:
    """Read a prescription.

    Args:
        path: Text file.

    Returns:
        The lens, as printed.

    Raises:
        LensError: The file is missing or damaged, or is no lens.
    """
    try:
        data = Path(path).read_bytes()[: MOST_BYTES + 1]
        text = data.decode("ascii")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise LensError(f"lens: cannot read prescription {path} ({reason})") from None
    if len(data) > MOST_BYTES:
        raise LensError(f"lens: prescription {path} is larger than {MOST_BYTES} bytes")
    return parse(text, str(path))


def parse(text: str, name: str = "lens") -> Prescription:
    """Read a prescription from text.

    Args:
        text: Lines of radius, distance to the next surface, index and diameter, in millimetres.
        name: Name for messages.

    Returns:
        The lens.

    Raises:
        LensError: A line is not four numbers in range, or there is not exactly one stop.
    """
    rows = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        sound = len(values) == 4 and np.isfinite(values).all() and values[1] >= 0 and values[3] > 0
        if not sound or (values[2] != 0 and not 1 <= values[2] <= 4):
            raise LensError(
                f"lens: {name}, line {number}: expected radius, distance >= 0, index (0 or 1 to 4), diameter > 0"
            )
        rows.append(values)
    if not 2 <= len(rows) <= MOST_SURFACES:
        raise LensError(f"lens: {name} has {len(rows)} surfaces; expected 2 to {MOST_SURFACES}")
    table = np.array(rows)
    index = np.where(table[:, 2] == 0, 1.0, table[:, 2])
    curvature = np.where(table[:, 0] == 0, 0.0, 1e3 / np.where(table[:, 0] == 0, 1, table[:, 0]))
    stops = np.flatnonzero((curvature == 0) & (index == 1) & (np.append(1.0, index[:-1]) == 1))
    if len(stops) != 1:
        raise LensError(f"lens: {name} has {len(stops)} stops; expected one line with radius 0 between air and air")
    return Prescription(curvature, table[:, 1] * 1e-3, index, table[:, 3] * 0.5e-3, int(stops[0]), name)
