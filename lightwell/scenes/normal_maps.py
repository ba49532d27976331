"""Normal maps in NumPy: the shading normal of surface points as the path tracer and rasterisers perturb it.

Notation: N points, vectors [3, N]; n the normal, on the camera's side; t along u, b along −v (glTF 2.0: green points up
in the image).
"""

from __future__ import annotations

import numpy as np

from lightwell.scenes.corners import Corners, Vertices, crosses, dots, lengths
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
    scene: Scene, vertices: Vertices, bends: np.ndarray, shape: np.ndarray, corners: Corners, normal: np.ndarray
) -> np.ndarray:
    """Perturb normals by the normal maps of the materials.

    Args:
        scene: Scene of the points.
        vertices: Its vertices.
        bends: [M] result of ``relief``.
        shape: [N] indices into ``scene.meshes``.
        corners: Corners of the points.
        normal: [3, N] unit interpolated normals on the camera's side.

    Returns:
        [3, N] float32 unit normals.
    """
    bent = np.array(normal, np.float32)
    number = np.where(bends[shape], vertices.material[shape], -1)
    for i in np.unique(number[number >= 0]):
        rows = np.flatnonzero(number == i)
        bent[:, rows] = _bent(scene.materials[i], vertices, corners[rows], bent[:, rows])
    return bent


def _uv(scene: Scene, mesh: Mesh) -> np.ndarray | None:
    texture = scene.materials[mesh.material].normal_texture
    if texture is None:
        return None
    return mesh.uv1 if texture.uv_set else mesh.uv0


def _bent(material: Material, vertices: Vertices, corners: Corners, normal: np.ndarray) -> np.ndarray:
    texture = material.normal_texture
    # Only meshes with relief come here.
    assert texture is not None
    uv = corners.values(vertices.uv1 if texture.uv_set else vertices.uv0)
    place = corners.values(vertices.positions)
    texel = sampled(texture, corners.between(uv), linear=True).astype(np.float64) * 2 - 1
    texel[:2] *= material.normal_scale
    (u1, v1), (u2, v2) = uv[1] - uv[0], uv[2] - uv[0]
    e1, e2 = place[1] - place[0], place[2] - place[0]
    turn = np.where(u1 * v2 - u2 * v1 < 0, -1.0, 1.0)
    along_u, along_v = (e1 * v2 - e2 * v1) * turn, (e2 * u1 - e1 * u2) * turn
    n = normal.astype(np.float64)
    t = along_u - n * dots(n, along_u)
    size = lengths(t)
    t /= np.maximum(size, 1e-300)
    b = crosses(n, t)
    b *= np.where(dots(b, along_v) > 0, -1.0, 1.0)
    # Seen from the back, bumps are dents; normals that point into the surface are mirrored to the camera's side.
    side = np.where(dots(crosses(e1, e2), n) < 0, -1.0, 1.0)
    bent = side * (texel[0] * t + texel[1] * b) + np.abs(texel[2]) * n
    length = lengths(bent)
    good = (length > SHORTEST) & (size > 0) & np.isfinite(length)
    return np.where(good, bent / np.maximum(length, SHORTEST), n).astype(np.float32)
