"""Depth of field and motion blur in one pass by Laplacian kernel splatting (Leimkühler, Seidel, Ritschel 2018).

    from lightwell import lens
    picture = lens.apply(rgba, depth, motion, lens.Camera(focus=2.5, fstop=1.8, focal=0.05))

In a precomputation, the Laplacian of every point spread function is replaced by a small signed point set, a
*spreadlet*. Per frame, every pixel scatters its colour times a spreadlet; one linear-time solve of the Poisson
equation turns the sum into the picture. See docs/lens.md.

Names are loaded at first use, so that the command line can build its parser without importing NumPy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lightwell.lens.aperture import Aperture as Aperture
    from lightwell.lens.camera import LensCamera
    from lightwell.lens.camera import from_thin_lens as from_thin_lens
    from lightwell.lens.errors import LensError as LensError
    from lightwell.lens.pipeline import Lens as Lens
    from lightwell.lens.pipeline import apply as apply
    from lightwell.lens.samples import reconstruct as reconstruct
    from lightwell.lens.settings import LensSettings

    Camera, Settings = LensCamera, LensSettings

# Public name → module, and the name there where it is longer.
_PUBLIC = {
    "Aperture": ("aperture", "Aperture"),
    "Camera": ("camera", "LensCamera"),
    "from_thin_lens": ("camera", "from_thin_lens"),
    "Lens": ("pipeline", "Lens"),
    "LensError": ("errors", "LensError"),
    "Settings": ("settings", "LensSettings"),
    "apply": ("pipeline", "apply"),
    "reconstruct": ("samples", "reconstruct"),
}

__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'lightwell.lens' has no attribute {name!r}")
    module, there = _PUBLIC[name]
    return getattr(import_module(f"lightwell.lens.{module}"), there)
