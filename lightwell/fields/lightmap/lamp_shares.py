"""Light of groups of lamps at the texels of an atlas and at samples of radiance towards views.

What a ray meets is lit by each group in turn (``transport.lamp_light``): many groups cost little more than one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lightwell.fields.lightmap.media import media_meshes
from lightwell.fields.lightmap.seams import seam_pairs
from lightwell.fields.lightmap.trace import AtlasIrradiance
from lightwell.fields.lightmap.views import eye_points, joined
from lightwell.fields.surface.lamps import facts_of_states, state_matrix
from lightwell.networks.losses import EPSILON
from lightwell.scenes.lamps import LampGroup
from lightwell.scenes.scene import Scene
from lightwell.transport.lamp_irradiance import irradiance_shares
from lightwell.transport.lamp_light import LampLight
from lightwell.transport.radiosity import PROBE_POINTS, Radiosity
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.surface import draw_surface

# Rays of a texel for each of its paths, and bounds; rays of a sample of radiance towards views.
RAYS_PER_PATH, FEWEST_RAYS, MOST_RAYS, EYE_RAYS = 0.5, 8, 64, 16
# Points by which the errors of the lamps are measured, their rays, and their shadow rays to each group.
HELD_OUT, HELD_OUT_RAYS, HELD_OUT_SHADOW_RAYS = 2048, 256, 16
# Largest share that is kept, below the largest half float.
LARGEST = 6e4
# Random streams that are shared with nothing else.
_POINTS, _BINS, _LIGHT, _TEXELS, _EYES, _HELD = range(0x51A0, 0x51A6)


@dataclass(frozen=True)
class LampTexels:
    """Light of K groups."""

    texels: np.ndarray
    """[T, K, 3] float16 irradiance / π at the texels, of each group in its unit."""
    units: np.ndarray
    """[K] mean of that over the texels."""
    eyes: np.ndarray
    """[N, K, 3] float32 radiance at the samples towards views; none where there is no network."""


@dataclass
class LampTracer:
    """Traces groups of lamps of a scene; its bins are made at the first use."""

    scene: Scene
    groups: tuple[LampGroup, ...]
    seed: int
    bins: int
    """Bins of surface to aim at."""

    @cached_property
    def light(self) -> LampLight:
        """The bins of the scene, lit by each group."""
        points = draw_surface(self.scene, PROBE_POINTS, self._seed(_POINTS), floor=8).points
        radiosity = Radiosity(self.scene, points, self._seed(_BINS), self.bins)
        return LampLight(radiosity, self.groups, self._seed(_LIGHT))

    def _seed(self, stream: int) -> int:
        return int(np.random.SeedSequence([self.seed, stream]).generate_state(1)[0])

    def texels(self, made: AtlasIrradiance, paths: int, eyes: SurfacePoints | None) -> LampTexels:
        """Trace the texels of an atlas, and samples towards views.

        Args:
            made: Atlas and irradiance of all lamps together.
            paths: Paths that these took per texel.
            eyes: N points towards views; None: there is no network.

        Returns:
            The light of each group.
        """
        rays = int(np.clip(RAYS_PER_PATH * paths, FEWEST_RAYS, MOST_RAYS)) // 2 * 2
        shares = irradiance_shares(self.light, made.texels.points, rays, self._seed(_TEXELS))
        units = np.maximum(shares[made.stored].mean(axis=(0, 2), dtype=np.float64), 1e-30)
        shares /= units[:, None].astype(np.float32)
        kept = np.minimum(shares, LARGEST).astype(np.float16)
        del shares
        seen = np.zeros((0, len(self.groups), 3), np.float32)
        if eyes is not None:
            radiance = self.light.shares(eyes, EYE_RAYS, self._seed(_EYES)).radiance
            seen = np.nan_to_num(radiance, posinf=0, neginf=0)
        return LampTexels(kept, units, seen)

    def held_out(self) -> tuple[SurfacePoints, np.ndarray]:
        """Trace points by which errors are measured.

        Returns:
            N points, and [N, K, 3] radiance of each group.
        """
        points = draw_surface(self.scene, HELD_OUT, self._seed(_HELD), floor=8, shown=True).points
        shares = self.light.shares(points, HELD_OUT_RAYS, self._seed(_HELD), HELD_OUT_SHADOW_RAYS)
        return points, np.nan_to_num(shares.radiance, posinf=0, neginf=0)


def eye_rows(scene: Scene, made: AtlasIrradiance, count: int, seed: int, across: int) -> SurfacePoints:
    """Find the points of samples towards views, those on seams included.

    Args:
        scene: The scene.
        made: Atlas and irradiance.
        count: Number of samples.
        seed: Seed of the samples; that of seams is two more.
        across: Samples on seams; 0: none.

    Returns:
        The points, in the order of the samples.
    """
    points = eye_points(scene, count, seed, made)[0]
    pairs = seam_pairs(scene, made, max(across // 2, 1), seed + 2) if across else None
    return points if pairs is None else joined([points, pairs.one, pairs.one])


def check_lamps(scene: Scene) -> None:
    """Refuse scenes whose light cannot be taken apart.

    Args:
        scene: The scene.

    Raises:
        ValueError: Shapes have a medium inside.
    """
    if media_meshes(scene).any():
        raise ValueError(
            "bake: light maps of scenes with media inside shapes learn all lights together; leave out --lamps, or "
            "remove the media"
        )


def lamp_facts(names: tuple[str, ...], found: np.ndarray, reference: np.ndarray, seed: int) -> dict[str, object]:
    """Compute the errors of states of the dimmers, the noise of the reference included.

    Args:
        names: K groups.
        found: [N, K, 3] radiance of each group alone, as it is shown.
        reference: [N, K, 3] traced.
        seed: Seed of the random states.

    Returns:
        Values for the report, as the default field has them.
    """
    states, errors = state_matrix(len(names), seed), []
    for state in states:
        f, y = (np.einsum("k,nkc->nc", state, x) for x in (found, reference))
        unit = 4 * max(float(y.mean()), 1e-30)
        errors.append(float(np.mean(np.abs(f - y) / (y + EPSILON * unit))))
    return facts_of_states(names, states, errors)
