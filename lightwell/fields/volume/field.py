"""The field ``volume``: a surface field whose grid and light are solved before its network is trained."""

from __future__ import annotations

from collections.abc import Callable

from lightwell.fields.base import FieldSetup, Learner
from lightwell.fields.protocol import Role, State
from lightwell.fields.surface.field import SurfaceField
from lightwell.fields.volume.fit import PRESETS, VolumeFit, solved
from lightwell.fields.volume.options import VolumeOptions


class VolumeField(SurfaceField):
    """See ``lightwell.fields.protocol.Field``."""

    Options = VolumeOptions
    learns_sky = False
    learns_turning = False

    def starter(self, state: State, role: Role) -> Callable[[FieldSetup, int], Learner]:
        """Return a function that solves the volume's light and makes an untrained network of the light.

        Args:
            state: The prepared scene.
            role: The part of the light to learn.

        Returns:
            Function of set-up and seed.
        """
        name, spacing = state.job.request.preset, getattr(state.job.options, "spacing", None)

        def start(setup: FieldSetup, seed: int) -> VolumeFit:
            return self.start(setup, name, seed, spacing)

        return start

    def start(self, setup: FieldSetup, preset: str, seed: int, spacing: float | None = None) -> VolumeFit:
        """Solve the volume's light and make an untrained network of the light.

        Args:
            setup: Set-up of the scene, made by ``FieldSetup.of``.
            preset: Name of a preset.
            seed: Seed of sampler and weights.
            spacing: Distance of neighbouring nodes, metres; None: see ``default_spacing``.

        Returns:
            The learner.
        """
        made = PRESETS[preset]
        return VolumeFit(setup, made, seed, solved(setup, made, seed, spacing))


FIELD = VolumeField("volume", PRESETS, VolumeFit, VolumeOptions)
