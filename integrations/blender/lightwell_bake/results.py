"""The results of a bake in Blender: the baked scene as a collection, the light map as an image on its materials."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np

# Name of the collection and of the image.
NAME = "lightwell"


def apply_light_map(context, folder: Path) -> int:
    """Import the baked scene and add albedo · light to its materials.

    Args:
        context: Blender's context.
        folder: What ``lightwell export --to threejs`` has written.

    Returns:
        Number of materials that have the light map.

    Raises:
        ValueError: The bake has no light map.
    """
    data = folder / "light_map.bin"
    texels = np.frombuffer(data.read_bytes(), "<f2").astype(np.float32) if data.is_file() else np.zeros(0, np.float32)
    side = math.isqrt(texels.size // 4)
    if side < 2 or side * side * 4 != texels.size:
        raise ValueError("the bake has no light map: choose Light maps under Learn and bake again")
    image = bpy.data.images.new(NAME, side, side, float_buffer=True, is_data=True)
    # Blender's first row is the lowest, glTF's the highest.
    image.pixels.foreach_set(texels.reshape(side, side, 4)[::-1].reshape(-1))
    image.pack()
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=str(folder / "scene.glb"))
    made = [found for found in bpy.data.objects if found not in before]
    _collect(context, made)
    materials = {
        (slot.material, _second_uv(found)) for found in made if found.type == "MESH" for slot in found.material_slots
    }
    lit = [(material, uv) for material, uv in materials if material is not None and uv]
    for material, uv in lit:
        add_light(material, image, uv)
    return len({material for material, _ in lit})


def _second_uv(found: bpy.types.Object) -> str:
    layers = found.data.uv_layers
    return layers[1].name if len(layers) > 1 else ""


def _collect(context, made: list[bpy.types.Object]) -> None:
    """Move objects into a collection of their own."""
    collection = bpy.data.collections.new(NAME)
    context.scene.collection.children.link(collection)
    for found in made:
        for other in list(found.users_collection):
            other.objects.unlink(found)
        collection.objects.link(found)


def add_light(material: bpy.types.Material, image: bpy.types.Image, uv: str) -> None:
    """Let a material emit base colour · light map instead of being lit.

    Args:
        material: A material of the glTF importer.
        image: The light map, irradiance / π.
        uv: Name of the UV map of the light map.
    """
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = next((node for node in nodes if node.type == "BSDF_PRINCIPLED"), None)
    output = next((node for node in nodes if node.type == "OUTPUT_MATERIAL"), None)
    if surface is None or output is None:
        return
    place, light = nodes.new("ShaderNodeUVMap"), nodes.new("ShaderNodeTexImage")
    product, emission = nodes.new("ShaderNodeVectorMath"), nodes.new("ShaderNodeEmission")
    place.uv_map, light.image, product.operation = uv, image, "MULTIPLY"
    light.name = light.label = NAME
    links.new(place.outputs["UV"], light.inputs["Vector"])
    links.new(light.outputs["Color"], product.inputs[0])
    color = surface.inputs["Base Color"]
    if color.is_linked:
        links.new(color.links[0].from_socket, product.inputs[1])
    else:
        product.inputs[1].default_value = color.default_value[:3]
    links.new(product.outputs["Vector"], emission.inputs["Color"])
    links.new(emission.outputs["Emission"], output.inputs["Surface"])
