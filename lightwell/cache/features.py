"""What the network is told about a vertex, and how it is laid out in memory."""

from __future__ import annotations

from lightwell.backend import dr, mi
from lightwell.cache.encodings import direction_blob, one_blob, triangle_wave

# Numbers per record: position 3, normal 3, direction 3, roughness 1, reflectances 3 + 3.
WIDTH = 16
# Channels whose reflectance is smaller predict exactly 0 and are not learned.
DARK = 1e-5


class Vertex:
    """Inputs of the cache at one vertex; one lane each."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "p": mi.Point3f, "n": mi.Vector3f, "w": mi.Vector3f, "r": mi.Float, "a": mi.Color3f, "b": mi.Color3f,
    }  # fmt: skip

    def __init__(self, p=None, n=None, w=None, r=None, a=None, b=None):
        self.p = mi.Point3f(0) if p is None else mi.Point3f(p)
        """Position in the scene's box, [0, 1]^3."""
        self.n = mi.Vector3f(0, 0, 1) if n is None else mi.Vector3f(n)
        """Shading normal on the side of the viewer, unit."""
        self.w = mi.Vector3f(0, 0, 1) if w is None else mi.Vector3f(w)
        """Direction to the previous vertex, unit."""
        self.r = mi.Float(0) if r is None else mi.Float(r)
        """Roughness: width of the GGX lobe, 1 diffuse, 0 mirror."""
        self.a = mi.Color3f(0) if a is None else mi.Color3f(a)
        """Diffuse reflectance."""
        self.b = mi.Color3f(0) if b is None else mi.Color3f(b)
        """Directional albedo of all else, transmission included."""

    def reflectance(self) -> mi.Color3f:
        """What the learned quantity is multiplied with."""
        return self.a + self.b

    def numbers(self) -> list[mi.Float]:
        """``WIDTH`` numbers."""
        return [*self.p, *self.n, *self.w, self.r, *self.a, *self.b]

    def store(self, table: mi.Float, row: mi.UInt32, active: mi.Bool) -> None:
        """Write to row ``row`` of a table of ``WIDTH`` columns."""
        numbers = self.numbers()
        for k in range(0, WIDTH, 4):
            dr.scatter(table, mi.Vector4f(*numbers[k : k + 4]), row * (WIDTH // 4) + k // 4, active)


def stored(table: mi.Float, row: mi.UInt32, active: mi.Bool = True) -> Vertex:
    """What ``Vertex.store`` wrote."""
    v: list[mi.Float] = []
    for k in range(WIDTH // 4):
        v += list(dr.gather(mi.Vector4f, table, row * (WIDTH // 4) + k, active))
    return Vertex(mi.Point3f(*v[0:3]), mi.Vector3f(*v[3:6]), mi.Vector3f(*v[6:9]), v[9], mi.Color3f(*v[10:13]),
                  mi.Color3f(*v[13:16]))  # fmt: skip


def squeezed(r: mi.Float) -> mi.Float:
    """Roughness as the network sees it."""
    return 1 - dr.exp(-r)


def raw_inputs(v: Vertex) -> list[mi.Float]:
    """16 inputs beside the hash grid: normal, direction, roughness, reflectances, and ones that act as a bias."""
    one = mi.Float(1)
    return [*v.n, *v.w, squeezed(v.r), *v.a, *v.b, one, one, one]


def paper_inputs(v: Vertex) -> list[mi.Float]:
    """The paper's 62 inputs and two ones."""
    waves = [value for coordinate in v.p for value in triangle_wave(coordinate)]
    one = mi.Float(1)
    return [*waves, *direction_blob(v.w), *direction_blob(v.n), *one_blob(squeezed(v.r)), *v.a, *v.b, one, one]
