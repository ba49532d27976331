"""The views of a report, with the lights that shine in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightwell.baking.evaluate import lights_of_views, lit_views, role_scale
from lightwell.baking.settings import Reported
from lightwell.fields.protocol import further_role
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Turning, Variable, first_settings
from lightwell.scenes.vectors import Vector


@dataclass(frozen=True)
class FurtherLight:
    """A further light that varies, in the views of a report."""

    role: str
    variable: Variable
    places: list[np.ndarray]
    """[3] of each view."""
    intensity: float
    """Candela or lux."""
    color: tuple[float, float, float]


@dataclass(frozen=True)
class ViewSetup:
    """The views of a report and their lights."""

    views: list[tuple[Camera, np.ndarray]]
    """Held-out cameras, each with a held-out light (zeros without a variable light); the page opens at the first."""
    intensity: float
    """First intensity of the light, candela or lux."""
    color: tuple[float, float, float]
    more: tuple[FurtherLight, ...] = ()
    """Further lights that vary, shown together with it."""

    def place(self, role: str, view: int) -> np.ndarray:
        """Return where the light of a role stands in a view.

        Args:
            role: The role.
            view: Number of the view.

        Returns:
            [3] position in metres, or direction towards the sun; any for the scene's own light.
        """
        found = next((light for light in self.more if light.role == role), None)
        return self.views[view][1] if found is None else found.places[view]

    def further(self, view: int) -> list[tuple[Variable, np.ndarray, float]]:
        """List the further lights of a view.

        Args:
            view: Number of the view.

        Returns:
            Each with its place [3] and its weight in a picture for a first light of 1 cd (1 lx).
        """
        return [(light.variable, light.places[view], self.weight(light.role)) for light in self.more]

    def weight(self, role: str) -> float:
        """Return the weight of a role in a picture for a first light of 1 cd (1 lx).

        Args:
            role: The role.

        Returns:
            Factor of the radiance.
        """
        found = next((light for light in self.more if light.role == role), None)
        return role_scale(role, self.intensity) * (1.0 if found is None else found.intensity / self.intensity)


def choose_stage(
    scene: Scene,
    variable: Variable | None,
    units: dict[str, float],
    settings: Reported,
    more: Sequence[Variable] = (),
) -> ViewSetup:
    """Choose held-out views and lights, and how bright the light is first.

    Args:
        scene: What is lit.
        variable: Ranges of the light; None: no light varies.
        units: Radiance unit S of each role.
        settings: Views, seed and declarations.
        more: Further lights that vary.

    Returns:
        The stage; the intensity makes the light's indirect radiance about 0.25, or as bright as the scene's own light.
    """
    views = lit_views(scene, variable, settings.views, settings.seed)
    if variable is None or "indirect" not in units:
        return ViewSetup(views, 1.0, (1.0, 1.0, 1.0))

    def first(role: str, name: str | None, lit: Variable) -> tuple[float, Vector]:
        declared, color = first_settings(settings.vary, name)
        # A map is as bright as its file says; the exposure adapts.
        usual = 1.0 if isinstance(lit, Turning) else units.get("static", 1.0) / units[role]
        return declared or float(f"{usual:.3g}"), color

    further, cameras = [], [camera for camera, _ in views]
    for light in more:
        role = further_role(light.name)
        if role in units:
            places = lights_of_views(scene, light, cameras, settings.seed)
            further.append(FurtherLight(role, light, places, *first(role, light.name, light)))
    return ViewSetup(views, *first("indirect", variable.name if more else None, variable), tuple(further))
