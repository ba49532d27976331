"""Small scenes with answers in closed form."""

from lightwell.backend import mi

T = mi.ScalarTransform4f
# A small network, trained on every pixel.
SMALL = {"levels": 3, "entries_log2": 10, "batch": 1024, "steps": 2, "train_fraction_max": 1.0, "max_vertices": 6}


def sensor(size=24, origin=(0, 0, 0), target=(0, 0, 1), spp=1, fov=60, rfilter="box"):
    return {
        "type": "perspective",
        "fov": fov,
        "to_world": T().look_at(origin=list(origin), target=list(target), up=[0, 1, 0]),
        "sampler": {"type": "independent", "sample_count": spp},
        "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": rfilter}},
    }


def furnace(albedo=(0.5, 0.5, 0.5), emission=1.0, size=24):
    """Camera in a closed sphere of one albedo that emits everywhere: E / (1 - albedo)."""
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(size, (0.3, 0, 0), (0.3, 0, 1)),
            "ball": {
                "type": "cube",
                "flip_normals": True,
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(albedo)}},
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": emission}},
            },
        }
    )


def room(size=24, bsdf=None, radiance=8.0, two_sided=False):
    """A closed box of grey walls, a small lamp under the ceiling, and one thing in it."""
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.5, 0.4]}}
    grey = {"type": "twosided", "bsdf": grey} if two_sided else grey
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(size, (0, 0, -0.9), (0, 0, 1), fov=75),
            "walls": {"type": "cube", "flip_normals": True, "bsdf": grey},
            "thing": {
                "type": "sphere",
                "center": [0.3, -0.6, 0.3],
                "radius": 0.3,
                "bsdf": bsdf or {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.2, 0.6, 0.3]}},
            },
            "lamp": {
                "type": "rectangle",
                "to_world": T().translate([0, 0.98, 0]).rotate([1, 0, 0], 90).scale(0.25),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
            },
        }
    )
