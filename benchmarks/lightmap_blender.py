"""Runs inside a Python that has bpy (Blender as a module): a small room, exported to glTF, and Cycles' light map of it.

    python lightmap_blender.py export ROOM.glb
    python lightmap_blender.py bake ROOM.glb OUT.npy SIZE SAMPLES[,SAMPLES…]

``export`` builds the room (Blender units are metres, z up) and writes it as Blender's exporter does. ``bake`` imports a
glTF whose meshes have a second set of texture coordinates and bakes diffuse light without colour, E = π E', into one
picture of SIZE² texels by CPU; prints SECONDS SAMPLES TIME for each count and writes [counts, SIZE, SIZE, 3] float32 of
E / π, row 0 on top.
"""

import sys
import time

import bpy
import numpy as np


def material(name: str, color, metallic: float, roughness: float):
    """A Principled BSDF."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    principled = made.node_tree.nodes["Principled BSDF"]
    principled.inputs["Base Color"].default_value = (*color, 1)
    principled.inputs["Metallic"].default_value = metallic
    principled.inputs["Roughness"].default_value = roughness
    return made


def empty() -> None:
    """Remove what Blender starts with."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


def export(path: str) -> None:
    """A floor, three walls, a ceiling, two boxes and a sphere under a point light."""
    empty()
    white, red = material("white", (0.7, 0.7, 0.7), 0.0, 0.9), material("red", (0.7, 0.1, 0.1), 0.0, 0.9)
    gloss = material("gloss", (0.8, 0.7, 0.5), 0.6, 0.4)

    def slab(place, size, look):
        bpy.ops.mesh.primitive_cube_add(size=1, location=place)
        thing = bpy.context.object
        thing.scale = size
        thing.data.materials.append(look)

    slab((0, 0, -0.05), (4, 4, 0.1), gloss)
    slab((0, 0, 3.05), (4, 4, 0.1), white)
    slab((-2.05, 0, 1.5), (0.1, 4, 3), red)
    slab((2.05, 0, 1.5), (0.1, 4, 3), white)
    slab((0, 2.05, 1.5), (4, 0.1, 3), white)
    slab((-0.7, 0.5, 0.6), (0.8, 0.8, 1.2), white)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=12, radius=0.5, location=(0.8, -0.3, 0.5))
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(white)
    light = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT"))
    light.data.energy, light.data.shadow_soft_size, light.location = 120, 0.0, (0.3, -0.6, 2.6)
    bpy.context.scene.collection.objects.link(light)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = (0, -5.2, 1.5), (np.pi / 2, 0, 0)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    bpy.ops.export_scene.gltf(filepath=path, export_lights=True, export_cameras=True)


def bake(path: str, out: str, size: int, counts: list[int]) -> None:
    """Cycles' diffuse light map of a glTF, on its TEXCOORD_1."""
    empty()
    bpy.ops.import_scene.gltf(filepath=path)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.render.bake.use_pass_direct = scene.render.bake.use_pass_indirect = True
    scene.render.bake.use_pass_color, scene.render.bake.margin = False, 2
    image = bpy.data.images.new("light", size, size, float_buffer=True, alpha=False)
    image.colorspace_settings.name = "Non-Color"
    meshes = [thing for thing in scene.objects if thing.type == "MESH"]
    bpy.ops.object.select_all(action="DESELECT")
    for thing in meshes:
        layers = thing.data.uv_layers
        while len(layers) > 1:
            layers.remove(layers[0])
        layers[0].name = "light"
        for look in thing.data.materials:
            node = look.node_tree.nodes.new("ShaderNodeTexImage")
            node.image = image
            look.node_tree.nodes.active = node
        thing.select_set(True)
    bpy.context.view_layer.objects.active = meshes[0]
    bpy.ops.object.join()
    found = []
    for count in counts:
        scene.cycles.samples = count
        start = time.perf_counter()
        bpy.ops.object.bake(type="DIFFUSE", use_clear=True)
        print("SECONDS", count, time.perf_counter() - start, flush=True)
        pixels = np.empty(size * size * 4, np.float32)
        image.pixels.foreach_get(pixels)
        found.append(pixels.reshape(size, size, 4)[::-1, :, :3])
    np.save(out, np.stack(found))


if __name__ == "__main__":
    verb, path, *rest = sys.argv[1:]
    if verb == "export":
        export(path)
    else:
        bake(path, rest[0], int(rest[1]), [int(n) for n in rest[2].split(",")])
