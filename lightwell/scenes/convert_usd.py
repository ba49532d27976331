"""Converts USD stages to GLB with usd-core; runs in a process of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.isolated import Arrays
from lightwell.scenes.convert_files import Folder
from lightwell.scenes.convert_usd_materials import Materials
from lightwell.scenes.glb_writer import GlbWriter

# From z up to y up.
Z_UP = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
# Types of primvars that are texture coordinates.
UV_TYPES = ("texCoord2f[]", "texCoord2d[]", "texCoord2h[]", "float2[]")
# Degrees from the axis of a spot: of one that shines everywhere, and of the widest that glTF has.
FULL_CONE, WIDEST_CONE = 180.0, 90.0
# Types of primitives that hold no light and no surface, and need no word.
SILENT = {
    "",
    "Scope",
    "Xform",
    "Material",
    "Shader",
    "NodeGraph",
    "GeomSubset",
    "SkelRoot",
    "Skeleton",
    "SkelAnimation",
}


def convert(request: Arrays) -> Arrays:
    """Convert a stage.

    Args:
        request: ``path``, the file; ``most_bytes``, what may be read in all.

    Returns:
        ``glb`` [n] uint8, the file in metres with y up; ``lost`` [m] text, what it does not hold.

    Raises:
        ValueError: The stage cannot be opened.
    """
    from pxr import Tf, Usd, UsdGeom

    path = Path(str(request["path"]))
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException:
        raise ValueError("its content is damaged, or it names a layer that is missing") from None
    writer, lost = GlbWriter(), set[str]()
    scale = UsdGeom.GetStageMetersPerUnit(stage)
    if not 0 < scale < np.inf:
        raise ValueError(f"its metersPerUnit is {scale}, expected a number above 0")
    world = np.diag([scale, scale, scale, 1.0])
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z:
        world = Z_UP @ world
    reader = _Reader(
        writer, world, scale, Materials(writer, Folder(path.parent, int(request["most_bytes"])), lost), lost
    )
    prims = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsA(UsdGeom.PointInstancer):
            # What lies below it are prototypes, which it alone places.
            prims.PruneChildren()
            reader.add_instances(prim)
        else:
            reader.add(prim)
    return {"glb": np.frombuffer(writer.encoded(), np.uint8), "lost": np.array(sorted(lost), dtype=str)}


class _Reader:
    """Adds the primitives of a stage to a GLB."""

    def __init__(
        self, writer: GlbWriter, world: np.ndarray, scale: float, materials: Materials, lost: set[str]
    ) -> None:
        from pxr import Usd, UsdGeom

        self._writer, self._world, self._scale = writer, world, scale
        self._materials, self._lost = materials, lost
        self._cache = UsdGeom.XformCache(Usd.TimeCode.EarliestTime())

    def add(self, prim: Any) -> None:
        """Add a primitive; what cannot be added is listed as lost."""
        if not _is_shown(prim):
            return
        kind, name = str(prim.GetTypeName()), str(prim.GetPath())
        adders = {"Mesh": self._mesh, "Camera": self._camera, "SphereLight": self._lamp, "DistantLight": self._sun}
        if kind in adders:
            adders[kind](prim, name)
        elif kind not in SILENT:
            self._lost.add(f"{kind} '{name}' is left out")

    def add_instances(self, prim: Any) -> None:
        """Add the meshes that a point instancer places."""
        from pxr import Usd, UsdGeom

        if not _is_shown(prim):
            return
        kind, name, first = UsdGeom.PointInstancer, str(prim.GetPath()), Usd.TimeCode.EarliestTime()
        instancer = kind(prim)
        numbers = np.asarray(instancer.GetProtoIndicesAttr().Get(first) or [], np.int64)
        steps = instancer.ComputeInstanceTransformsAtTime(first, first, kind.IncludeProtoXform, kind.IgnoreMask)
        steps = np.asarray(steps or [], np.float64).reshape(-1, 4, 4)
        mask = np.asarray(instancer.ComputeMaskAtTime(first) or np.ones(len(numbers)), bool)
        if not len(numbers) == len(steps) == len(mask):
            self._lost.add(f"PointInstancer '{name}' has no place for each instance and is left out")
            return
        for k, path in enumerate(instancer.GetPrototypesRel().GetForwardedTargets()):
            places = [self._matrix(prim) @ step.T for step in steps[mask & (numbers == k)]]
            root = prim.GetStage().GetPrimAtPath(path)
            if root and places:
                self._prototype(root, places)

    def _prototype(self, root: Any, places: Sequence[np.ndarray]) -> None:
        """Add the meshes of a prototype at the world matrices of its instances."""
        from pxr import Usd

        for prim in Usd.PrimRange(root, Usd.TraverseInstanceProxies()):
            kind, name = str(prim.GetTypeName()), str(prim.GetPath())
            if not _is_shown(prim):
                continue
            if kind == "Mesh":
                # The matrix of the prototype itself is in those of its instances.
                local, _ = self._cache.ComputeRelativeTransform(prim, root)
                self._mesh(prim, name, np.array(local).T, places)
            elif kind not in SILENT:
                self._lost.add(f"{kind} '{name}' is left out")

    def _matrix(self, prim: Any) -> np.ndarray:
        """World matrix of column vectors, in metres with y up."""
        return self._world @ np.array(self._cache.GetLocalToWorldTransform(prim)).T

    def _rigid(self, prim: Any) -> np.ndarray:
        """The same without scale: for lights and cameras."""
        matrix = self._matrix(prim)
        lengths = np.linalg.norm(matrix[:3, :3], axis=0)
        matrix[:3, :3] /= np.where(lengths > 0, lengths, 1)
        return matrix

    def _mesh(
        self, prim: Any, name: str, matrix: np.ndarray | None = None, places: Sequence[np.ndarray] | None = None
    ) -> None:
        """Add a mesh in world space, or by a matrix in the space of its instances."""
        from pxr import Usd, UsdGeom

        mesh, first = UsdGeom.Mesh(prim), Usd.TimeCode.EarliestTime()
        points = np.asarray(mesh.GetPointsAttr().Get(first) or [], np.float64).reshape(-1, 3)
        counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get(first) or [], np.int64)
        corners = np.asarray(mesh.GetFaceVertexIndicesAttr().Get(first) or [], np.int64)
        if (
            counts.sum() != len(corners)
            or counts.min(initial=3) < 0
            or (len(corners) and not _inside(corners, len(points)))
        ):
            raise ValueError(f"mesh '{name}': its faces name vertices that do not exist")
        if mesh.GetSubdivisionSchemeAttr().Get() not in (None, "none") and counts.max(initial=3) > 3:
            self._lost.add(f"mesh '{name}': its subdivision is ignored")
        matrix = self._matrix(prim) if matrix is None else matrix
        flipped = (mesh.GetOrientationAttr().Get() == "leftHanded") != (np.linalg.det(matrix[:3, :3]) < 0)
        attributes = {"POSITION": (points @ matrix[:3, :3].T + matrix[:3, 3])[corners]}
        normals = _values(UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals"), counts, corners, 3)
        if normals is None:
            normals = _attribute(mesh.GetNormalsAttr(), str(mesh.GetNormalsInterpolation()), counts, corners)
        if normals is not None:
            attributes["NORMAL"] = _directions(normals, matrix)
        for material, faces in self._materials.parts(prim, len(counts)):
            triangles = _fans(counts, faces)
            if len(triangles):
                uv = self._coordinates(prim, name, self._materials.coordinates.get(material), counts, corners)
                if uv is not None:
                    attributes["TEXCOORD_0"] = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)
                colors = _colors(prim, counts, corners) if material in self._materials.painted else None
                if colors is not None:
                    attributes["COLOR_0"] = colors
                used, indices = np.unique(triangles, return_inverse=True)
                indices = indices.reshape(-1, 3)[:, ::-1] if flipped else indices.reshape(-1, 3)
                taken = {key: values[used] for key, values in attributes.items()}
                self._writer.mesh(name, taken, indices, material, places)
                attributes.pop("COLOR_0", None)

    def _coordinates(
        self, prim: Any, name: str, wanted: str | None, counts: np.ndarray, corners: np.ndarray
    ) -> np.ndarray | None:
        """[C, 2] texture coordinates at every corner: those that a material names, ``st``, or the only ones."""
        from pxr import UsdGeom

        primvars = UsdGeom.PrimvarsAPI(prim)
        found = [p.GetPrimvarName() for p in primvars.GetPrimvarsWithValues() if str(p.GetTypeName()) in UV_TYPES]
        for called in (wanted, "st", found[0] if len(found) == 1 else None):
            uv = _values(primvars.GetPrimvar(called), counts, corners, 2) if called else None
            if uv is not None:
                return uv
        if wanted is not None:
            self._lost.add(f"mesh '{name}': has no texture coordinates '{wanted}'; its pictures are one colour")
        return None

    def _camera(self, prim: Any, name: str) -> None:
        from pxr import Usd, UsdGeom

        camera = UsdGeom.Camera(prim).GetCamera(Usd.TimeCode.EarliestTime())
        if str(camera.projection) != "Gf.Camera.Perspective":
            self._lost.add(f"camera '{name}' is not perspective and is left out")
            return
        fov_y = 2 * np.arctan(0.5 * camera.verticalAperture / max(camera.focalLength, 1e-6))
        self._writer.camera(prim.GetName(), float(fov_y), self._rigid(prim))

    def _power(self, prim: Any) -> tuple[np.ndarray, float]:
        """Colour, of which the temperature is a factor, and radiance."""
        from pxr import Usd, UsdLux

        light, first = UsdLux.LightAPI(prim), Usd.TimeCode.EarliestTime()
        intensity = float(light.GetIntensityAttr().Get(first)) * 2.0 ** float(light.GetExposureAttr().Get(first))
        color = np.asarray(light.GetColorAttr().Get(first), float)
        if light.GetEnableColorTemperatureAttr().Get(first):
            kelvin = float(light.GetColorTemperatureAttr().Get(first))
            color = color * np.asarray(UsdLux.BlackbodyTemperatureAsRgb(kelvin), float)
        return color, intensity

    def _lamp(self, prim: Any, name: str) -> None:
        """A sphere that emits radiance L is a lamp of π r² L candela seen from afar; of L / 4 where it is normalised,
        with lengths in units of the stage."""
        from pxr import Usd, UsdLux

        color, radiance = self._power(prim)
        lamp, first = UsdLux.SphereLight(prim), Usd.TimeCode.EarliestTime()
        # Metres of a unit of the lamp's own space.
        scale = float(np.cbrt(abs(np.linalg.det(self._matrix(prim)[:3, :3]))))
        radius = float(lamp.GetRadiusAttr().Get(first)) * scale
        if not lamp.GetTreatAsPointAttr().Get(first):
            self._lost.add(f"SphereLight '{name}': its shadows are those of a point")
        normalised = UsdLux.LightAPI(prim).GetNormalizeAttr().Get(first)
        entry = {
            "name": prim.GetName(),
            "color": color.tolist(),
            "intensity": (self._scale**2 / 4 if normalised else np.pi * radius**2) * radiance,
            **self._shape(prim, name),
        }
        self._writer.light(entry, self._rigid(prim))

    def _shape(self, prim: Any, name: str) -> dict[str, Any]:
        """Type of a lamp: a spot where its cone is said, else a point."""
        from pxr import Usd, UsdLux

        shaping, first = UsdLux.ShapingAPI(prim), Usd.TimeCode.EarliestTime()
        said = shaping.GetShapingConeAngleAttr() if prim.HasAPI(UsdLux.ShapingAPI) else None
        if prim.HasAPI(UsdLux.ShapingAPI) and (
            shaping.GetShapingFocusAttr().Get(first) or shaping.GetShapingIesFileAttr().Get(first)
        ):
            self._lost.add(f"SphereLight '{name}': its focus and its light distribution are ignored")
        if not said or not said.HasAuthoredValue() or said.Get(first) >= FULL_CONE:
            return {"type": "point"}
        if said.Get(first) > WIDEST_CONE:
            self._lost.add(f"SphereLight '{name}': its cone is cut to {WIDEST_CONE:g}°")
        outer = float(np.radians(np.clip(said.Get(first), 0, WIDEST_CONE)))
        softness = float(np.clip(shaping.GetShapingConeSoftnessAttr().Get(first), 0, 1))
        return {"type": "spot", "spot": {"innerConeAngle": outer * (1 - softness), "outerConeAngle": outer}}

    def _sun(self, prim: Any, name: str) -> None:
        """A distant light of radiance L over a disc of angle a gives π sin²(a/2) L lux; where normalised, L lux."""
        from pxr import Usd, UsdLux

        color, radiance = self._power(prim)
        first = Usd.TimeCode.EarliestTime()
        angle = np.radians(float(UsdLux.DistantLight(prim).GetAngleAttr().Get(first)))
        normalised = UsdLux.LightAPI(prim).GetNormalizeAttr().Get(first) or angle <= 0
        lux = radiance if normalised else np.pi * np.sin(angle / 2) ** 2 * radiance
        entry = {"type": "directional", "name": prim.GetName(), "color": color.tolist(), "intensity": float(lux)}
        self._writer.light(entry, self._rigid(prim))


def _is_shown(prim: Any) -> bool:
    from pxr import UsdGeom

    imageable = UsdGeom.Imageable(prim)
    return not imageable or (
        imageable.ComputeVisibility() != "invisible" and imageable.ComputePurpose() not in ("guide", "proxy")
    )


def _inside(indices: np.ndarray, count: int) -> bool:
    return bool(indices.min() >= 0 and indices.max() < count)


def _fans(counts: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """[T, 3] corners of the triangles of some faces, each cut into a fan."""
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(counts) else counts
    parts = []
    for n in np.unique(counts[faces]):
        first = starts[faces[counts[faces] == n]]
        parts += [np.stack([first, first + k, first + k + 1], axis=1) for k in range(1, int(n) - 1)]
    return np.concatenate(parts) if parts else np.zeros((0, 3), np.int64)


def _values(primvar: Any, counts: np.ndarray, corners: np.ndarray, width: int) -> np.ndarray | None:
    """A primvar at every corner; None where it is missing or has another size."""
    from pxr import Usd

    if not primvar or not primvar.HasValue():
        return None
    values = primvar.ComputeFlattened(Usd.TimeCode.EarliestTime())
    return _spread(np.asarray(values, float), str(primvar.GetInterpolation()), counts, corners, width)


def _colors(prim: Any, counts: np.ndarray, corners: np.ndarray) -> np.ndarray | None:
    """[C, 3] linear display colour at every corner."""
    from pxr import UsdGeom

    colors = _values(UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor"), counts, corners, 3)
    return None if colors is None else colors.clip(0, 1)


def _attribute(attribute: Any, interpolation: str, counts: np.ndarray, corners: np.ndarray) -> np.ndarray | None:
    from pxr import Usd

    values = attribute.Get(Usd.TimeCode.EarliestTime())
    return None if not values else _spread(np.asarray(values, float), interpolation, counts, corners, 3)


def _spread(
    values: np.ndarray, interpolation: str, counts: np.ndarray, corners: np.ndarray, width: int
) -> np.ndarray | None:
    """Values by vertex, corner, face or mesh as values by corner."""
    if values.ndim != 2 or values.shape[1] != width:
        return None
    face = np.repeat(np.arange(len(counts)), counts)
    index = {
        "vertex": corners,
        "varying": corners,
        "faceVarying": np.arange(len(corners)),
        "uniform": face,
        "constant": np.zeros(len(corners), np.int64),
    }.get(interpolation)
    return values[index] if index is not None and (not len(index) or _inside(index, len(values))) else None


def _directions(normals: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Unit normals in world space."""
    turned = normals @ np.linalg.pinv(matrix[:3, :3])
    return turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12)
