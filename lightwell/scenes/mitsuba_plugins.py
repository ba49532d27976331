"""Mitsuba plug-ins that a scene file may name, and the nested objects that each of them needs.

A plug-in is native code that Mitsuba loads by its name, so a file may name only those listed here. One of Mitsuba's own
plug-ins is deliberately not listed: ``blender`` (a shape made of memory addresses).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

NAME = re.compile(r"[a-z0-9_]+")

_SPECTRA = frozenset("blackbody d65 irregular rawconstant regular srgb uniform".split())
_TEXTURES = frozenset("bitmap checkerboard mesh_attribute volume".split()) | _SPECTRA

# Integrators and sensors' parts are checked by name and not used; names of Mitsuba 0.x are accepted there.
_INTEGRATORS = """
    path direct volpath volpathmis ptracer aov depth moment stokes prb prb_basic prbvolpath prb_projective
    direct_projective volprim_rf_basic lightwell_nrc ao volpath_simple photonmapper ppm sppm bdpt pssmlt mlt erpt
    adaptive vpl irrcache multichannel field"""
_FILMS = "hdrfilm specfilm ldrfilm tiledhdrfilm mfilm exrfilm pngfilm"
_SAMPLERS = "independent stratified multijitter orthogonal ldsampler halton hammersley sobol"
_FILTERS = "box tent gaussian mitchell catmullrom lanczos"

# Element → plug-ins.
PLUGINS: dict[str, frozenset[str]] = {
    "shape": frozenset(
        "bsplinecurve cube cylinder disk ellipsoids ellipsoidsmesh instance linearcurve merge obj ply rectangle "
        "sdfgrid serialized shapegroup sphere".split()
    ),
    "bsdf": frozenset(
        "blendbsdf bumpmap circular conductor dielectric diffuse hair mask measured measured_polarized normalmap null "
        "plastic polarizer pplastic principled principledthin retarder roughconductor roughdielectric roughplastic "
        "thindielectric twosided".split()
    ),
    "texture": _TEXTURES,
    "spectrum": _TEXTURES,
    "emitter": frozenset(
        "area constant directional directionalarea envmap point projector spot sunsky timed_sunsky".split()
    ),
    "sensor": frozenset("batch distant irradiancemeter orthographic perspective radiancemeter thinlens".split()),
    "medium": frozenset("heterogeneous homogeneous".split()),
    "phase": frozenset("blendphase hg isotropic rayleigh sggx tabphase".split()),
    "volume": frozenset("constvolume gridvolume".split()),
    "integrator": frozenset(_INTEGRATORS.split()),
    "film": frozenset(_FILMS.split()),
    "sampler": frozenset(_SAMPLERS.split()),
    "rfilter": frozenset(_FILTERS.split()),
}

# Replacements of objects that lightwell does not use.
UNUSED = {"integrator": "path", "film": "hdrfilm", "sampler": "independent", "rfilter": "box"}

# Shapes that cannot become triangles, and so are never made.
NO_TRIANGLES = frozenset("bsplinecurve ellipsoids ellipsoidsmesh linearcurve sdfgrid".split())


@dataclass(frozen=True)
class Needs:
    """Nested objects without which a plug-in cannot be made."""

    kind: str
    """Tag of the nested element."""
    least: int
    most: int


NEEDS: dict[tuple[str, str], Needs] = {
    ("bsdf", "mask"): Needs("bsdf", 1, 1),
    ("bsdf", "twosided"): Needs("bsdf", 1, 2),
    ("bsdf", "normalmap"): Needs("bsdf", 1, 1),
    ("bsdf", "bumpmap"): Needs("bsdf", 1, 1),
    ("bsdf", "blendbsdf"): Needs("bsdf", 2, 2),
    ("shape", "instance"): Needs("shape", 1, 1),
}

# (element, plug-in) → kind of its file; each needs a string 'filename'.
FILES: dict[tuple[str, str], str] = {
    ("texture", "bitmap"): "picture",
    ("spectrum", "bitmap"): "picture",
    ("emitter", "envmap"): "picture",
    ("shape", "ply"): "ply",
    ("shape", "obj"): "obj",
    ("shape", "serialized"): "serialized",
    ("bsdf", "measured"): "measured",
    ("bsdf", "measured_polarized"): "measured",
    ("volume", "gridvolume"): "volume",
}
