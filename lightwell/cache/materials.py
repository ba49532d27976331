"""Tables of roughness and non-diffuse albedo of the scene's materials, by material and angle.

Mitsuba has no query for either. Roughness comes from a table of plugins; the albedo of all non-diffuse lobes is the
mean sample weight of the BSDF over a fixed set of points (so that the network's inputs are free of noise) minus the
diffuse reflectance.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats

# Angles of the table, and samples of one entry, which are spread over the texture.
ANGLES, SAMPLES = 16, 256
# GGX width of a rough plugin where the file names none (Mitsuba's default).
DEFAULT_ALPHA = 0.1
# Plugins without roughness, and those with a diffuse lobe only.
SMOOTH = {"conductor", "dielectric", "thindielectric", "null"}
DIFFUSE = {"diffuse", "pplastic"}
ROUGH = {"roughconductor", "roughdielectric", "roughplastic", "plastic", "principled", "principledthin", "measured",
         "hair"}  # fmt: skip
# Largest share of values that are not finite; a material above it is refused.
MOST_BROKEN = 0.01


@dataclass(frozen=True)
class CacheMaterialTable:
    """Roughness and albedo of the M registered BSDFs; rows of BSDFs that are not in the scene are zero."""

    roughness: Any
    """[M] Float, [0, 1]."""
    albedo: Any
    """[M * ANGLES * 4] Float: directional albedo of the non-diffuse lobes, by |cos| of the viewing angle."""
    highest: float
    """Largest sum of both albedos; above one, a material does not conserve energy."""


def lookup(
    roughness: mi.Float, albedo: mi.Float, bsdf: Any, cosine: mi.Float, active: mi.Bool
) -> tuple[mi.Float, mi.Color3f]:  # fmt: skip
    """Look up roughness and albedo, interpolated linearly in the cosine.

    Args:
        roughness: [M] roughness.
        albedo: [M * ``ANGLES`` * 4] albedo.
        bsdf: BSDFs, one per lane.
        cosine: [N] cosine of the viewing angle.
        active: [N] mask of the active lanes.

    Returns:
        Roughness and albedo of the non-diffuse lobes, [N] each.
    """
    row = dr.reinterpret_array(mi.UInt32, bsdf)
    at = dr.clip(dr.abs(cosine) * ANGLES - 0.5, 0, ANGLES - 1)
    low = dr.minimum(mi.UInt32(at), ANGLES - 2)
    t = at - mi.Float(low)
    a = dr.gather(mi.Vector4f, albedo, row * ANGLES + low, active)
    b = dr.gather(mi.Vector4f, albedo, row * ANGLES + low + 1, active)
    mean = a + t * (b - a)
    return dr.gather(mi.Float, roughness, row, active), mi.Color3f(mean.x, mean.y, mean.z)


def material_table(scene: Any) -> CacheMaterialTable:
    """Compute the tables of all materials of a scene.

    Args:
        scene: Mitsuba scene.

    Returns:
        Tables on the device.
    """
    bsdfs = {}
    # The shapes of groups are not among those of the scene, but what instances show has their materials.
    nested = [node for node in mi.traverse(scene).hierarchy if isinstance(node, mi.Shape)]
    for shape in [*scene.shapes(), *nested]:
        bsdf = shape.bsdf()
        if bsdf is not None:
            number = int(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdf))[0])
            bsdfs[number] = bsdf
    rows = max(bsdfs, default=0) + 1
    roughness = np.zeros(rows, np.float32)
    albedo = np.zeros((rows, ANGLES, 4), np.float32)
    numbers = np.array(sorted(bsdfs), np.uint32)
    for number, bsdf in bsdfs.items():
        roughness[number] = _roughness(bsdf)
    if len(numbers):
        total, diffuse, broken = _albedos(numbers)
        _refuse(bsdfs, numbers, broken)
        albedo[numbers, :, :3] = np.maximum(total - diffuse, 0)
    highest = float((albedo[numbers, :, :3] + diffuse).max()) if len(numbers) else 0.0
    table = CacheMaterialTable(upload_floats(roughness), upload_floats(albedo.ravel()), highest)
    dr.eval(table.roughness, table.albedo)
    return table


def _albedos(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean sample weight and diffuse reflectance [M, ANGLES, 3] by angle; share of values that are not finite [M]."""
    count = len(numbers) * ANGLES * SAMPLES
    lane = dr.arange(mi.UInt32, count)
    sample = lane % SAMPLES
    angle = (lane // SAMPLES) % ANGLES
    which = dr.gather(mi.UInt32, mi.UInt32(numbers), lane // (SAMPLES * ANGLES))
    bsdf = dr.reinterpret_array(mi.BSDFPtr, which)
    # Increments of the R sequence (Roberts 2018), a low-discrepancy sequence.
    golden = [1.0 / 1.1673039782614187 ** (k + 1) for k in range(5)]
    u = [x - dr.floor(x) for x in (mi.Float(sample) * g for g in golden)]
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    cosine = (mi.Float(angle) + 0.5) / ANGLES
    si.wi = mi.Vector3f(dr.sqrt(1 - cosine * cosine), 0, cosine)
    si.uv = mi.Point2f(u[3], u[4])
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(mi.Vector3f(0, 0, 1))
    si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
    _, weight = bsdf.sample(mi.BSDFContext(), si, u[0], mi.Point2f(u[1], u[2]), True)
    diffuse = bsdf.eval_diffuse_reflectance(si, True)
    sound = np.array(dr.all(dr.isfinite(weight)) & dr.all(dr.isfinite(diffuse))).reshape(len(numbers), -1)
    out = []
    for value in (weight, diffuse):
        total = np.array(dr.select(dr.isfinite(value), value, 0)).T.reshape(len(numbers), ANGLES, SAMPLES, 3)
        out.append(total.mean(axis=2))
    return out[0], out[1], 1 - sound.mean(axis=1)


def _refuse(bsdfs: dict[int, Any], numbers: np.ndarray, broken: np.ndarray) -> None:
    """Refuse materials that often return values that are not finite; rare ones are ignored."""
    for number, share in zip(numbers, broken):
        if share > MOST_BROKEN:
            bsdf = bsdfs[int(number)]
            raise ValueError(
                f"nrc: {share:.0%} of the values of material '{bsdf.id() or bsdf.class_name()}' are not finite; "
                "correct its parameters (a negative or missing colour, roughness or index of refraction)"
            )


def _roughness(bsdf: Any) -> float:
    """GGX width of a material, averaged over the lobes of mixtures: 0 for mirrors, 1 for diffuse materials."""
    name = bsdf.class_name().lower().replace("bsdf", "")
    values = {k: v for k, v in mi.traverse(bsdf)}
    alphas = [_mean(v) for k, v in values.items() if {"alpha", "alpha_u", "alpha_v"} & set(k.split("."))]
    alphas += [_mean(v) ** 2 for k, v in values.items() if "roughness" in k.split(".")]
    flags = bsdf.flags()
    has: Callable[[Any], bool] = lambda flag: mi.has_flag(flags, flag)  # noqa: E731
    shares = []
    if has(mi.BSDFFlags.DiffuseReflection) or has(mi.BSDFFlags.DiffuseTransmission):
        shares.append(1.0)
    if has(mi.BSDFFlags.GlossyReflection) or has(mi.BSDFFlags.GlossyTransmission):
        shares.append(float(np.mean(alphas)) if alphas else DEFAULT_ALPHA)
    if has(mi.BSDFFlags.DeltaReflection) or has(mi.BSDFFlags.DeltaTransmission):
        shares.append(0.0)
    known = SMOOTH | DIFFUSE | ROUGH | {"twosidedbrdf", "maskbsdf", "bumpmap", "normalmap", "blend",
                                        "smoothconductor",
                                        "smoothdielectric", "smoothdiffuse", "smoothplastic"}  # fmt: skip
    if not alphas and name not in known and has(mi.BSDFFlags.GlossyReflection):
        # Python shows a warning of one text once.
        warnings.warn(f"nrc: roughness of the BSDF plugin '{name}' is unknown; {DEFAULT_ALPHA} is taken", stacklevel=2)
    return float(np.mean(shares)) if shares else 0.0


def _mean(value: Any) -> float:
    try:
        return float(np.mean(np.array(value)))
    except (TypeError, ValueError):
        return DEFAULT_ALPHA
