"""Checking and cleaning of mesh records, and their conversion to Mitsuba meshes. V vertices, T triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NoReturn

import numpy as np

from lightwell.backend import mi, upload_floats, upload_integers
from lightwell.scenes.errors import SceneError
from lightwell.scenes.scene import Mesh

# A triangle smaller than this fraction of the squared extent of the scene has no usable normal in single precision.
SMALLEST_AREA = 1e-14
# ... up to this extent, metres: under a dome of sky of 100 km the furniture's triangles would count as none.
MOST_EXTENT = 1000.0
# Meshes that a warning of lost triangles names.
MOST_NAMED = 3


def clean(mesh: Mesh, extent: float) -> Mesh | None:
    """Remove triangles of zero area and normalise normals.

    Args:
        mesh: Mesh to clean.
        extent: Longest edge of the scene's bounds, metres.

    Returns:
        The cleaned mesh, or None when no triangle is left.
    """
    good = mesh.triangle_areas > SMALLEST_AREA * min(extent, MOST_EXTENT) ** 2
    if not good.any():
        return None
    mesh = replace(mesh, indices=np.ascontiguousarray(mesh.indices[good]))
    return mesh if mesh.normals is None else replace(mesh, normals=_unit_normals(mesh, mesh.normals))


def warn_of_dropped(pairs: Sequence[tuple[Mesh, Mesh | None]], warn: Callable[[str], None]) -> None:
    """Tell which meshes lost triangles without area; many meshes share one line, so that other warnings are seen.

    Args:
        pairs: Each mesh before and after cleaning.
        warn: Called with each line.
    """
    counts = [(mesh.name, len(mesh.indices), 0 if kept is None else len(kept.indices)) for mesh, kept in pairs]
    lost = [(name, before, before - after) for name, before, after in counts if after < before]
    if len(lost) > MOST_NAMED:
        total, dropped = (sum(column) for column in list(zip(*lost))[1:])
        first = ", ".join(f"'{name}'" for name, _, _ in lost[:MOST_NAMED])
        warn(f"{len(lost)} meshes ({first} …): dropped {dropped} of {total} triangles, which have no area")
        return
    for name, before, dropped in lost:
        warn(f"mesh '{name}': dropped {dropped} of {before} triangles, which have no area")


def checked(scene: str, mesh: Mesh, material_count: int) -> Mesh:
    """Check the arrays of a mesh and convert them to the documented types.

    An array of the wrong shape, numbers that are not finite and indices out of range raise ``SceneError``.

    Args:
        scene: Name of the scene, for messages.
        mesh: Mesh to check.
        material_count: Number of materials of the scene.

    Returns:
        The mesh with contiguous arrays.
    """

    def fail(what: str) -> NoReturn:
        raise SceneError(f"scene '{scene}': mesh '{mesh.name}' {what}")

    count = len(mesh.positions)
    shapes = {"positions": 3, "normals": 3, "uv0": 2, "uv1": 2, "colors": 4}
    arrays: dict[str, Any] = {}
    for name, width in shapes.items():
        if (values := getattr(mesh, name)) is None:
            continue
        values = np.ascontiguousarray(values, np.float32)
        if values.shape != (count, width):
            fail(f"has {name} of shape {list(values.shape)}, expected {[count, width]}; export it again")
        if not np.isfinite(values).all():
            fail(f"has {name} that are not finite numbers; repair the mesh and export it again")
        arrays[name] = values
    indices = np.ascontiguousarray(mesh.indices, np.uint32)
    if indices.ndim != 2 or indices.shape[1:] != (3,):
        fail(f"has indices of shape {list(indices.shape)}, expected [triangles, 3]; export it again")
    if indices.size and indices.max() >= count:
        fail(f"names vertex {int(indices.max())} but has {count} vertices; export it again")
    if not 0 <= mesh.material < material_count:
        fail(f"names material {mesh.material} but the scene has {material_count}; export it again")
    return replace(mesh, **(arrays | {"indices": indices}))


def _unit_normals(mesh: Mesh, normals: np.ndarray) -> np.ndarray:
    """Normalise normals [V, 3]; a zero normal becomes that of the triangles around the vertex."""
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    if (bad := length[:, 0] < 1e-6).any():
        around = smooth_normals(mesh.positions, mesh.indices)
        return np.where(bad[:, None], around, normals / np.maximum(length, 1e-6)).astype(np.float32)
    return (normals / length).astype(np.float32)


def smooth_normals(positions: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """Compute vertex normals: the area-weighted mean of the triangles around each vertex.

    Args:
        positions: [V, 3] positions.
        indices: [T, 3] triangles.

    Returns:
        [V, 3] float32 unit normals.
    """
    a, b, c = (positions[indices[:, k]].astype(np.float64) for k in range(3))
    face = np.cross(b - a, c - a)
    total = np.zeros((len(positions), 3))
    for k in range(3):
        np.add.at(total, indices[:, k], face)
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0])
    return np.where(length > 0, total / np.where(length > 0, length, 1), up).astype(np.float32)


def mirrored_uv(mesh: Mesh, uv: np.ndarray | None) -> bool:
    """Test whether most of the surface shows its texture mirrored (seen from the front).

    Args:
        mesh: Mesh with positions and triangles.
        uv: [V, 2] texture coordinates; None: no texture.

    Returns:
        True for a mirrored texture.
    """
    if uv is None:
        return False
    a, b, c = (uv[mesh.indices[:, k]].astype(np.float64) for k in range(3))
    # v points down, so an unmirrored triangle that turns left in space turns right in (u, v).
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return float((np.sign(turn) * mesh.triangle_areas).sum()) > 0


def mitsuba_mesh(
    mesh: Mesh,
    bsdf: Any,
    *,
    emitter: Any = None,
    uv: np.ndarray | None = None,
    colors: np.ndarray | None = None,
    alpha: np.ndarray | None = None,
) -> Any:
    """Make an ``mi.Mesh`` of a record, with the same vertices and triangles in the same order.

    Args:
        mesh: Record of the mesh.
        bsdf: Mitsuba BSDF of the surface.
        emitter: Mitsuba area emitter of the surface, or None.
        uv: [V, 2] the only set of texture coordinates that Mitsuba gets, or None.
        colors: [V, 3] mesh attribute ``vertex_color``, or None.
        alpha: [V, 1] mesh attribute ``vertex_alpha``, or None.

    Returns:
        The ``mi.Mesh``.
    """
    props = mi.Properties()
    props["bsdf"] = bsdf
    if emitter is not None:
        props["emitter"] = emitter
    if mesh.normals is None:
        props["face_normals"] = True
    result = mi.Mesh(
        mesh.name,
        len(mesh.positions),
        len(mesh.indices),
        props=props,
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=uv is not None,
    )
    params = mi.traverse(result)
    params["vertex_positions"] = upload_floats(mesh.positions.ravel())
    params["faces"] = upload_integers(mesh.indices.ravel())
    if mesh.normals is not None:
        params["vertex_normals"] = upload_floats(mesh.normals.ravel())
    if uv is not None:
        params["vertex_texcoords"] = upload_floats(uv.ravel())
    params.update()
    if colors is not None:
        result.add_attribute("vertex_color", 3, np.ascontiguousarray(colors, np.float32).ravel())
    if alpha is not None:
        result.add_attribute("vertex_alpha", 1, np.ascontiguousarray(alpha, np.float32).ravel())
    return result
