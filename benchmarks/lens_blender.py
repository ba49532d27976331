"""Runs inside a Python that has bpy 5: Blender's Defocus node on a picture and a map of blur radii in pixels.

    python lens_blender.py RGB.exr RADIUS.exr OUT.exr LARGEST

Prints SECONDS without the node and with it; the node reads radii directly (no Z-buffer), so that both blur alike.
"""

import sys
import time

import bpy

picture, radii, out, largest = sys.argv[1:5]
scene = bpy.context.scene
for thing in list(bpy.data.objects):
    bpy.data.objects.remove(thing)
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(camera)
scene.camera = camera
scene.render.engine = "CYCLES"
scene.cycles.samples = 1
scene.cycles.use_denoising = False
scene.view_settings.view_transform = "Raw"
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.filepath = out

tree = bpy.data.node_groups.new("lens", "CompositorNodeTree")
scene.compositing_node_group = tree
tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
sources = []
for path in (picture, radii):
    node = tree.nodes.new("CompositorNodeImage")
    node.image = bpy.data.images.load(path)
    sources.append(node)
scene.render.resolution_x, scene.render.resolution_y = sources[0].image.size
scene.render.resolution_percentage = 100
defocus = tree.nodes.new("CompositorNodeDefocus")
defocus.use_zbuffer, defocus.z_scale, defocus.blur_max, defocus.bokeh = False, 1.0, float(largest), "CIRCLE"
end = tree.nodes.new("NodeGroupOutput")
tree.links.new(sources[0].outputs[0], defocus.inputs[0])
tree.links.new(sources[1].outputs[0], defocus.inputs[1])


def seconds(node) -> float:
    """One render whose compositor ends with this node."""
    for link in list(tree.links):
        if link.to_node == end:
            tree.links.remove(link)
    tree.links.new(node.outputs[0], end.inputs[0])
    start = time.perf_counter()
    bpy.ops.render.render(write_still=True)
    return time.perf_counter() - start


seconds(sources[0])
without = min(seconds(sources[0]) for _ in range(2))
print("SECONDS", without, seconds(defocus), flush=True)
