"""Network inputs of a path vertex and their layout in memory."""

from __future__ import annotations

from lightwell.backend import dr, mi
from lightwell.cache.encodings import direction_blob, one_blob, triangle_wave

# Numbers per record: position 3, normal 3, direction 3, roughness 1, reflectances 3 + 3.
WIDTH = 16
# Channels whose reflectance is smaller predict exactly 0 and are not learned.
DARK = 1e-5


class Vertex:
    """Network inputs at a path vertex, one per lane."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "p": mi.Point3f, "n": mi.Vector3f, "w": mi.Vector3f, "r": mi.Float, "a": mi.Color3f, "b": mi.Color3f,
    }  # fmt: skip

    def __init__(
        self, p: mi.Point3f | None = None, n: mi.Vector3f | None = None, w: mi.Vector3f | None = None,
        r: mi.Float | None = None, a: mi.Color3f | None = None, b: mi.Color3f | None = None,
    ) -> None:  # fmt: skip
        """Set the inputs; each one that is None has a default.

        Args:
            p: [N] positions in [0, 1]^3.
            n: [N] unit normals.
            w: [N] unit directions.
            r: [N] roughness in [0, 1].
            a: [N] diffuse reflectance in [0, 1].
            b: [N] directional albedo of the other lobes.
        """
        self.p = mi.Point3f(0) if p is None else mi.Point3f(p)
        """Position relative to the scene's box, [0, 1]^3."""
        self.n = mi.Vector3f(0, 0, 1) if n is None else mi.Vector3f(n)
        """Shading normal on the side of the viewer, unit."""
        self.w = mi.Vector3f(0, 0, 1) if w is None else mi.Vector3f(w)
        """Direction to the previous vertex, unit."""
        self.r = mi.Float(0) if r is None else mi.Float(r)
        """Roughness: width of the GGX lobe, 1 diffuse, 0 mirror."""
        self.a = mi.Color3f(0) if a is None else mi.Color3f(a)
        """Diffuse reflectance."""
        self.b = mi.Color3f(0) if b is None else mi.Color3f(b)
        """Directional albedo of all other lobes, transmission included."""

    def reflectance(self) -> mi.Color3f:
        """Return the factor between the learned quantity and radiance.

        Returns:
            [N] sum of diffuse reflectance and directional albedo.
        """
        return self.a + self.b

    def numbers(self) -> list[mi.Float]:
        """List all inputs in the order of storage.

        Returns:
            ``WIDTH`` arrays [N].
        """
        return [*self.p, *self.n, *self.w, self.r, *self.a, *self.b]

    def store(self, table: mi.Float, row: mi.UInt32, active: mi.Bool) -> None:
        """Write the inputs to rows of a table.

        Args:
            table: [R * ``WIDTH``] numbers, changed in place.
            row: [N] row of each lane.
            active: [N] mask of the lanes that write.
        """
        numbers = self.numbers()
        for k in range(0, WIDTH, 4):
            dr.scatter(table, mi.Vector4f(*numbers[k : k + 4]), row * (WIDTH // 4) + k // 4, active)


def stored(table: mi.Float, row: mi.UInt32, active: mi.Bool | bool = True) -> Vertex:
    """Read vertices that ``Vertex.store`` wrote.

    Args:
        table: [R * ``WIDTH``] numbers.
        row: [N] row of each lane.
        active: [N] mask of the lanes that read; others have zeros.

    Returns:
        Vertices, one per lane.
    """
    v: list[mi.Float] = []
    for k in range(WIDTH // 4):
        v += list(dr.gather(mi.Vector4f, table, row * (WIDTH // 4) + k, active))
    return Vertex(mi.Point3f(*v[0:3]), mi.Vector3f(*v[3:6]), mi.Vector3f(*v[6:9]), v[9], mi.Color3f(*v[10:13]),
                  mi.Color3f(*v[13:16]))  # fmt: skip


def side(n: mi.Vector3f) -> mi.UInt32:
    """Find the axis and the sign that normals are nearest to.

    Args:
        n: [N] normals.

    Returns:
        [N] 2 * axis + (1 if negative).
    """
    a = dr.abs(n)
    axis = dr.select((a.x >= a.y) & (a.x >= a.z), mi.UInt32(0), dr.select(a.y >= a.z, mi.UInt32(1), mi.UInt32(2)))
    along = dr.select(axis == 0, n.x, dr.select(axis == 1, n.y, n.z))
    return 2 * axis + dr.select(along < 0, mi.UInt32(1), 0)


def squeezed(r: mi.Float) -> mi.Float:
    """Map roughness to the network's input.

    Args:
        r: [N] roughness in [0, 1].

    Returns:
        [N] 1 - exp(-r).
    """
    return 1 - dr.exp(-r)


def raw_inputs(v: Vertex) -> list[mi.Float]:
    """List the inputs used with a hash grid: normal, direction, roughness, reflectances, and three ones (a bias).

    Args:
        v: Vertices.

    Returns:
        16 arrays [N].
    """
    one = mi.Float(1)
    return [*v.n, *v.w, squeezed(v.r), *v.a, *v.b, one, one, one]


def paper_inputs(v: Vertex) -> list[mi.Float]:
    """List the 62 inputs of Müller et al. 2021 and two ones that act as a bias.

    Args:
        v: Vertices.

    Returns:
        64 arrays [N].
    """
    waves = [value for coordinate in v.p for value in triangle_wave(coordinate)]
    one = mi.Float(1)
    return [*waves, *direction_blob(v.w), *direction_blob(v.n), *one_blob(squeezed(v.r)), *v.a, *v.b, one, one]
