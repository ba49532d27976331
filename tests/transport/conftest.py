"""Scenes that several transport tests share, built once for each file, and gone when the next begins."""

from __future__ import annotations

import pytest

from lightwell.scenes.variables import PointLight

from . import rooms


@pytest.fixture(scope="module")
def cornell():
    """All diffuse."""
    return rooms.cornell()


@pytest.fixture
def glossy():
    """Floor of rough plastic, a glass box and a box of rough metal; walls diffuse."""
    return rooms.cornell(
        tall={"type": "dielectric", "int_ior": 1.5},
        short={"type": "roughconductor", "alpha": 0.15},
        floor={"type": "twosided", "bsdf": {"type": "roughplastic", "alpha": 0.2}},
    )


@pytest.fixture(scope="module")
def principled():
    """A half-metallic principled floor and box, and a mirror."""
    material = {"type": "principled", "roughness": 0.3, "metallic": 0.5, "specular": 0.5}
    material["base_color"] = {"type": "rgb", "value": [0.7, 0.5, 0.3]}
    return rooms.cornell(
        tall={"type": "twosided", "bsdf": {"type": "conductor"}},
        short={"type": "twosided", "bsdf": material},
        floor={"type": "twosided", "bsdf": material},
    )


@pytest.fixture(scope="module")
def roaming():
    """A point light that roams the room."""
    return PointLight((-0.8, 0.2, -0.8), (0.8, 1.8, 0.8), 0.05)
