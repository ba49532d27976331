"""Files for Unreal: a light map for the second texture coordinates, and each field as the code of a Custom node."""

from __future__ import annotations

import re

from lightwell.asset.export import Exported
from lightwell.asset.records import FieldEntry
from lightwell.engines.bake import Bake
from lightwell.engines.exr_files import exr_bytes
from lightwell.engines.shaders import function_names, shader_files
from lightwell.engines.text import render
from lightwell.limits import Limits

# What the inputs of a field are in a Custom node: its own inputs in Unreal's units and axes, brought to glTF's.
INPUTS = {
    "position": ("WorldPosition", "WorldPosition.xzy / 100"),
    "normal": ("VertexNormalWS", "VertexNormalWS.xzy"),
    "view": ("CameraVectorWS", "CameraVectorWS.xzy"),
    "shading_normal": ("PixelNormalWS", "PixelNormalWS.xzy"),
    "light": ("LightPosition", "LightPosition.xzy / 100"),
    "reflectance": ("Reflectance", "Reflectance"),
    "roughness": ("Roughness", "Roughness"),
    "metallic": ("Metallic", "Metallic"),
    "uv": ("TexCoord0", "TexCoord0"),
    "uv1": ("TexCoord1", "TexCoord1"),
}


def files(bake: Bake, limits: Limits | None) -> dict[str, bytes]:
    """Make the files of Unreal.

    Args:
        bake: The bake.
        limits: Largest file, memory and work that the asset may need; None for the defaults of ``Limits``.

    Returns:
        Content by name.
    """
    printed_files, printed = shader_files(bake, "hlsl", limits)
    made = {name.replace(".hlsl", ".ush"): data for name, data in printed_files.items()}
    names = function_names(bake.fields)
    for entry in bake.fields:
        name = names[entry.name]
        made[f"{name}.custom-node.txt"] = custom_node(entry, name, printed[name]).encode()
    if bake.light_map is not None:
        made["light_map.exr"] = exr_bytes(bake.light_map)
    return made


def custom_node(entry: FieldEntry, name: str, printed: Exported) -> str:
    """Describe the Custom node of a field.

    Args:
        entry: The field.
        name: Name of its function.
        printed: Its HLSL.

    Returns:
        Text with the inputs, the textures and the code of the node.

    Raises:
        ValueError: The field reads what Unreal has no input for, such as the dimmers of lamps.
    """
    used = [input for input in entry.graph.only("radiance").inputs]
    if unknown := [input for input in used if input not in INPUTS]:
        raise ValueError(
            f"export: field '{entry.name}' reads {', '.join(unknown)}, which a Custom node of Unreal has not; take it "
            f"with --to hlsl --field {entry.name}, or bake without --lamps"
        )
    textures = re.findall(r"Texture2D<float4> (\w+)", printed.text.split(f"float3 {name}(")[-1].split(")")[0])
    sampled = [texture for texture in textures if texture in printed.pictures]
    arguments = [INPUTS[input][1] for input in used]
    for texture in textures:
        # A Custom node calls the sampler of its texture input X XSampler.
        arguments += [texture, f"{texture}Sampler"] if texture in sampled else [texture]
    names = ", ".join(dict.fromkeys(INPUTS[input][0] for input in used))
    gain = "colour and intensity of the declared light" if entry.role == "indirect" else "one"
    code = f"return max({name}({', '.join(arguments)}), 0.0);"
    return render("unreal.txt", name=name, inputs=names, textures=", ".join(textures) or "none", code=code, gain=gain)
