"""Blur one layer: choose nodes, collect points, scatter, solve."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from lightwell.core.suggest import did_you_mean
from lightwell.lens import pyramid, solve
from lightwell.lens.bake import FINE
from lightwell.lens.choose import choose
from lightwell.lens.errors import LensError
from lightwell.lens.families import Family
from lightwell.lens.layers import Layer, lit
from lightwell.lens.library import Library
from lightwell.lens.library_cache import LibraryCache
from lightwell.lens.recipes import Recipe, primal
from lightwell.lens.report import Report
from lightwell.lens.splat import Frame, Planes, Points, Sources, guard_for, splat
from lightwell.lens.spreadlet import CHARGE, Spreadlet

SOLVERS = ("dst", "fft", "7/5", "5/3")
# Error, relative to white, above which a pixel uses the lossless tier.
TOLERANCE = 0.001
# Light above this multiple of white is written as a dense kernel, because single precision would make the solve ring.
EXTREME = 2000.0
# Recipes without error (except rounding).
EXACT = ("primal", "lossless")
# Tier of dense kernels; made when needed, never stored.
DENSE = 2


@contextmanager
def timed(report: Report, stage: str) -> Iterator[None]:
    """Add the run time of a block to a stage of a report.

    Args:
        report: Report to change.
        stage: Name of the stage.

    Yields:
        Nothing.
    """
    start = time.perf_counter()
    yield
    report.seconds[stage] = report.seconds.get(stage, 0.0) + time.perf_counter() - start


@dataclass(frozen=True)
class SolvePlan:
    """What one layer scatters: the points of all records in use, and one source per pixel that has light."""

    points: Points
    sources: Sources
    turned: bool


class Engine:
    """Blurs layers with one library; keeps what does not change between frames."""

    def __init__(
        self,
        family: Family,
        recipe: Recipe,
        libraries: LibraryCache,
        solver: str = "dst",
        choice: str = "auto",
        tolerance: float = TOLERANCE,
        white: float = 1.0,
    ) -> None:
        """Open the library of a family.

        Args:
            family: Family of kernels.
            recipe: How missing spreadlets are made.
            libraries: Libraries.
            solver: ``dst``, ``fft``, ``7/5`` or ``5/3``.
            choice: Node of a value between two: ``stochastic``, ``nearest`` or ``auto``.
            tolerance: Error, relative to ``white``, above which a bright pixel uses lossless points; infinity: never.
            white: Scene-referred value that is displayed as white, > 0.

        Raises:
            LensError: The solver is unknown.
        """
        if solver not in SOLVERS:
            cure = did_you_mean(solver, SOLVERS, f"there are {', '.join(SOLVERS)}")
            raise LensError(f"lens: no solver {solver!r}; {cure}")
        self.family, self.recipe, self.libraries = family, recipe, libraries
        self.solver, self.tolerance, self.white = solver, tolerance, white
        # The steps of a family with one axis are too small to be visible; dither would be the larger error.
        self.choice = ("nearest" if family.name == "depth" else "stochastic") if choice == "auto" else choice
        self.library: Library = libraries.library(family, recipe)
        # Dense kernels of nodes that extremely bright pixels used.
        self._dense: dict[int, Spreadlet] = {}

    def plan(self, layer: Layer, report: Report, frame_number: int = 0, border: int = 0) -> SolvePlan:
        """Choose node, tier and rotation of every pixel of a layer that has light or coverage.

        Args:
            layer: The layer.
            report: Report to change.
            frame_number: Frame number, for the dither.
            border: Pixels on each side of the layer that lie outside the picture.

        Returns:
            What the layer scatters.
        """
        with timed(report, "plan"):
            shining = lit(layer.rgba)
            y, x = (places.astype(np.int32) for places in np.nonzero(shining))
            rgba, s = layer.rgba[shining], layer.s[shining].astype(np.float32, copy=False)
            motion = None if layer.motion is None else layer.motion[shining]
            shape = layer.s.shape
        return self.plan_samples(x, y, rgba, s, motion, shape, report, frame_number, border)

    def plan_samples(
        self,
        x: np.ndarray,
        y: np.ndarray,
        rgba: np.ndarray,
        s: np.ndarray,
        motion: np.ndarray | None,
        shape: tuple[int, int],
        report: Report,
        frame_number: int = 0,
        border: int = 0,
    ) -> SolvePlan:
        """Choose node, tier and rotation of samples.

        Args:
            x: Position x of the samples [n], pixels: integers, or real numbers where the family is rotated.
            y: Position y of the samples [n], pixels.
            rgba: Light of the samples [n, 4], premultiplied.
            s: Signed circle of confusion [n], pixels.
            motion: Displacement while the shutter is open [n, 2], pixels; None for none.
            shape: Height and width of the frame, pixels.
            report: Report to change.
            frame_number: Frame number, for the dither.
            border: Pixels on each side of the frame that lie outside the picture; they have the field of its corners.

        Returns:
            What the samples scatter.
        """
        with timed(report, "plan"):
            second, angle, cosine, sine = self._turn(x, y, s, motion, shape, border)
            hash_x, hash_y = (np.floor(v).astype(np.int32) for v in (x, y))
            node, clamped = choose(self.family, np.abs(s), second, angle, hash_x, hash_y, frame_number, self.choice)
            report.clamped += clamped
        used = np.unique(node)
        with timed(report, "bake"):
            self.libraries.ensure(self.library, used)
        with timed(report, "plan"):
            tier = self._tier(node, rgba, report)
            key = node * 3 + tier
            # A frame has few records: a table gives their numbers faster than sorting a million keys.
            present = np.zeros(int(key.max()) + 1 if len(key) else 1, np.int64)
            present[key] = 1
            keys = np.nonzero(present)[0]
            present[keys] = np.arange(len(keys))
            record = present[key].astype(np.uint32)
            points = self._pack(keys)
            sources = Sources(x, y, np.ascontiguousarray(rgba, np.float32), record, cosine, sine)
            self._count(report, points, record, node, used)
        return SolvePlan(points, sources, sine is not None)

    def _turn(
        self,
        x: np.ndarray,
        y: np.ndarray,
        s: np.ndarray,
        motion: np.ndarray | None,
        shape: tuple[int, ...],
        border: int,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
        """Return value on the second axis, baked angle, and cosine and sine of the rotation of every pixel."""
        n = len(s)
        sign = np.where(s < 0, -1, 1).astype(np.float32)
        none = np.zeros(n, np.float32)
        if self.family.name == "depth":
            return none, none, sign, None
        if self.family.by_field:
            cy, cx = (shape[0] - 1) / 2, (shape[1] - 1) / 2
            dx, dy = (x - cx).astype(np.float32), (y - cy).astype(np.float32)
            far = np.hypot(dx, dy)
            safe = np.maximum(far, 1e-9)
            if (lens := self.family.lens) is not None:
                # The side of the focus is baked: nothing is mirrored.
                at, side = far * np.float32(lens.pitch / lens.half), (s > 0).astype(np.float32)
                return np.minimum(at, 1), side, np.where(far > 0, dx / safe, 1), np.where(far > 0, dy / safe, 0)
            at = np.minimum(far / max(np.hypot(cx - border, cy - border), 1e-9), 1)
            return at, none, np.where(far > 0, dx / safe, 1) * sign, np.where(far > 0, dy / safe, 0) * sign
        mx, my = (motion[:, 0], motion[:, 1]) if motion is not None else (none, none)
        length = np.hypot(mx, my)
        safe = np.maximum(length, 1e-9)
        if self.family.name == "depth-speed":
            still = length < 1e-6
            return (
                length,
                none,
                np.where(still, 1, mx / safe).astype(np.float32),
                np.where(still, 0, my / safe).astype(np.float32),
            )
        # A segment has no direction: the angle of the motion is baked over half a turn.
        return length, np.mod(np.arctan2(my, mx), np.pi), sign, None

    def _tier(self, node: np.ndarray, rgba: np.ndarray, report: Report) -> np.ndarray:
        """Return 0, or 1 where colour × error of the node exceeds the tolerance, or 2 where the light is extreme."""
        red, green, blue = (np.abs(rgba[:, channel]) for channel in range(3))
        light = np.maximum(np.maximum(red, green), blue) / self.white
        tier = np.zeros(len(node), np.int64)
        if not np.isfinite(self.tolerance):
            return tier
        error = np.zeros(self.family.size, np.float32)
        better = np.full(self.family.size, DENSE)
        charge = np.zeros(self.family.size, bool)
        for (index, which), spreadlet in self.library.nodes.items():
            if which == FINE:
                better[index] = FINE
            elif spreadlet.recipe not in EXACT:
                error[index] = spreadlet.score.peak
            charge[index] |= spreadlet.kind == CHARGE
        bright = light * error[node] > self.tolerance
        tier[bright] = better[node[bright]]
        tier[(light > EXTREME) & charge[node]] = DENSE
        report.fine += int((tier > 0).sum())
        return tier

    def _pack(self, keys: np.ndarray) -> Points:
        """Concatenate the points of records (node·3 + tier)."""
        return Points.of([self._spreadlet(int(key) // 3, int(key) % 3) for key in keys])

    def _spreadlet(self, node: int, tier: int) -> Spreadlet:
        if tier == DENSE:
            if node not in self._dense:
                self._dense[node] = primal(self.family.kernel(node))
            return self._dense[node]
        return self.library.nodes[node, tier]

    def _count(self, report: Report, points: Points, record: np.ndarray, node: np.ndarray, used: np.ndarray) -> None:
        """Add writes per pixel to the report, and those of dense kernels: π r² + 2 r ℓ pixels each."""
        if not len(record):
            return
        per_node = np.zeros(self.family.size)
        for n in used:
            r, second, _ = self.family.node(int(n))
            length = 0.0 if self.family.by_field else second
            per_node[n] = max(np.pi * (r + 0.5) ** 2 + 2 * (r + 0.5) * length, 1.0)
        sources = len(record)
        weight = sources / max(report.pixels + sources, 1)
        report.points += weight * (float(points.count[record].mean()) - report.points)
        report.dense += weight * (float(per_node[node].mean()) - report.dense)
        report.pixels += sources
        report.nodes += len(used)

    def blur(self, layer: Layer, report: Report, frame_number: int = 0) -> np.ndarray:
        """Blur one layer; light that leaves the frame is lost.

        Args:
            layer: The layer.
            report: Report to change.
            frame_number: Frame number, for the dither.

        Returns:
            Blurred layer [height, width, 4] float32, premultiplied.
        """
        return self.render([self.plan(layer, report, frame_number)], layer.s.shape, report)

    def render(
        self,
        plans: Sequence[SolvePlan],
        shape: tuple[int, int],
        report: Report,
        scatter: Callable[[Frame, Points, Sources], Planes] = splat,
    ) -> np.ndarray:
        """Scatter plans into one image and solve it once.

        Args:
            plans: What is scattered, one or more.
            shape: Height and width of the frame, pixels.
            report: Report to change.
            scatter: Function that scatters one plan.

        Returns:
            Blurred layer [height, width, 4] float32, premultiplied.
        """
        frame = Frame(*shape, max(guard_for(plan.points, plan.turned) for plan in plans))
        report.guard = max(report.guard, frame.guard)
        with timed(report, "splat"):
            planes = scatter(frame, plans[0].points, plans[0].sources)
            for plan in plans[1:]:
                planes = planes + scatter(frame, plan.points, plan.sources)
        with timed(report, "solve"):
            return self.integrate(frame, planes)

    def integrate(self, frame: Frame, planes: Planes) -> np.ndarray:
        """Solve the scattered charges and add the picture plane.

        Args:
            frame: Size of the picture and its guard band.
            planes: What was scattered.

        Returns:
            Blurred layer [height, width, 4], without the guard band.
        """
        picture: np.ndarray = np.zeros((), np.float32)
        if planes.picture is not None:
            picture = frame.crop(planes.picture.transpose(2, 0, 1))
        if planes.charges is not None:
            charges = np.ascontiguousarray(planes.charges.transpose(2, 0, 1))
            solvers: dict[str, Callable[[np.ndarray], np.ndarray]] = {
                "dst": solve.dst,
                "fft": solve.fft,
                "7/5": lambda f: pyramid.integrate(f, pyramid.SEVEN),
                "5/3": lambda f: pyramid.integrate(f, pyramid.FIVE),
            }
            picture = picture + frame.crop(solvers[self.solver](charges))
        return picture.transpose(1, 2, 0)
