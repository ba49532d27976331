"""Normal maps in NumPy: the shading normal of surface points as the path tracer and rasterisers perturb it.

Notation: N points; n the normal, on the camera's side; t along u, b along −v (glTF 2.0: green points up in the image).
"""

from __future__ import annotations

import numpy as np

from lightwell.scenes.materials import sampled
from lightwell.scenes.scene import Material, Mesh, Scene

# Texels and tangents shorter than this have no direction; the normal is not changed.
SHORTEST = 1e-6


def has_relief(material: Material) -> bool:
    """Test whether a material has a normal map with an effect.

    Args:
        material: Material to inspect.

    Returns:
        True when the map perturbs normals.
    """
    return material.normal_texture is not None and material.normal_scale != 0


def relief(scene: Scene) -> np.ndarray:
    """Find the meshes whose material has a normal map and that have texture coordinates for it.

    Args:
        scene: Scene with M meshes.

    Returns:
        [M] bool.
    """
    return np.array([has_relief(scene.materials[m.material]) and _uv(scene, m) is not None for m in scene.meshes], bool)


def shading_normals(
    scene: Scene, shape: np.ndarray, triangle: np.ndarray, barycentric: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Perturb normals by the normal maps of the materials.

    Args:
        scene: Scene of the points.
        shape: [N] indices into ``scene.meshes``.
        triangle: [N] indices into that mesh's triangles.
        barycentric: [N, 2] weights of the triangle's second and third vertex.
        normal: [N, 3] unit interpolated normals on the camera's side.

    Returns:
        [N, 3] float32 unit normals.
    """
    bent = np.array(normal, np.float32)
    for number in np.unique(np.asarray(shape)[relief(scene)[shape]]):
        rows = np.flatnonzero(shape == number)
        bent[rows] = _bent(scene, scene.meshes[number], triangle[rows], barycentric[rows], normal[rows])
    return bent


def _uv(scene: Scene, mesh: Mesh) -> np.ndarray | None:
    texture = scene.materials[mesh.material].normal_texture
    if texture is None:
        return None
    return mesh.uv1 if texture.uv_set else mesh.uv0


def _bent(scene: Scene, mesh: Mesh, triangle: np.ndarray, barycentric: np.ndarray, normal: np.ndarray) -> np.ndarray:
    material, corners = scene.materials[mesh.material], mesh.indices[triangle].astype(np.int64)
    b = np.asarray(barycentric, np.float64)
    weights = np.stack([1 - b[:, 0] - b[:, 1], b[:, 0], b[:, 1]], axis=1)
    texture, coordinates = material.normal_texture, _uv(scene, mesh)
    # Only meshes with relief come here.
    assert texture is not None and coordinates is not None
    uv, place = coordinates[corners].astype(np.float64), mesh.positions[corners].astype(np.float64)
    at = (weights[..., None] * uv).sum(axis=1)
    texel = sampled(texture, (at, at), linear=True).astype(np.float64) * 2 - 1
    texel *= [material.normal_scale, material.normal_scale, 1]
    (u1, v1), (u2, v2) = (uv[:, k].T - uv[:, 0].T for k in (1, 2))
    e1, e2 = place[:, 1] - place[:, 0], place[:, 2] - place[:, 0]
    turn = np.where(u1 * v2 - u2 * v1 < 0, -1.0, 1.0)[:, None]
    along_u, along_v = (e1 * v2[:, None] - e2 * v1[:, None]) * turn, (e2 * u1[:, None] - e1 * u2[:, None]) * turn
    n = normal.astype(np.float64)
    t = along_u - n * (n * along_u).sum(axis=1, keepdims=True)
    size = np.linalg.norm(t, axis=1, keepdims=True)
    t /= np.maximum(size, 1e-300)
    b = np.cross(n, t)
    b *= np.where((b * along_v).sum(axis=1, keepdims=True) > 0, -1.0, 1.0)
    # Seen from the back, bumps are dents; normals that point into the surface are mirrored to the camera's side.
    side = np.where((np.cross(e1, e2) * n).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    bent = side * (texel[:, :1] * t + texel[:, 1:2] * b) + np.abs(texel[:, 2:]) * n
    length = np.linalg.norm(bent, axis=1, keepdims=True)
    good = (length > SHORTEST) & (size > 0) & np.isfinite(bent).all(axis=1, keepdims=True)
    return np.where(good, bent / np.maximum(length, SHORTEST), n).astype(np.float32)
