"""Compiles printed HLSL with glslang and runs it through wgpu, one thread a point."""

import base64
import functools
import json
import subprocess
from pathlib import Path

import numpy as np
import wgpu

ROOT = Path(__file__).parents[2]
VECTORS = ROOT / "format/vectors"
# Types by width.
TYPES = ("float", "float2", "float3", "float4")
# Formats of textures of numbers.
FORMATS = {"rgba16float": np.float16, "rgba32float": np.float32}


def blocks(width: int) -> int:
    """Vectors of four that hold a value."""
    return -(-width // 4)


def programs(language: str) -> dict[tuple[str, str], dict]:
    """Every vector printed in a language, by its name and the place of the weights."""
    command = ["node", str(ROOT / "tools/print-shaders.mjs"), language]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return {(program["name"], program["weights"]): program for program in json.loads(done.stdout)}


def shader(program: dict) -> str:
    """A compute shader around the printed function: inputs in `given`, outputs in `result`, a row of blocks a point."""
    given, body, arguments = 0, [], []
    for i, parameter in enumerate(program["parameters"]):
        width, count = parameter["width"], blocks(parameter["width"])
        if width > 4:
            body.append(f"float4 a{i}[{count}];")
            body += [f"a{i}[{k}] = given[base + {given + k}];" for k in range(count)]
        else:
            body.append(f"{TYPES[width - 1]} a{i} = given[base + {given}].{'xyzw'[:width]};")
        given += count
        arguments.append(f"a{i}")
    arguments += [texture["name"] for texture in program["textures"]]
    call, written = f"field({', '.join(arguments)})", sum(blocks(output["width"]) for output in program["outputs"])
    if "field_result" not in program["signature"]:
        zeros = ", 0.0" * (4 - program["outputs"][0]["width"])
        body.append(f"result[id.x] = float4({call}{zeros});")
    else:
        body.append(f"field_result found = {call};")
        members = [(i, b) for i, output in enumerate(program["outputs"]) for b in range(blocks(output["width"]))]
        body += [f"result[id.x * {written} + {at}] = found.o{i}[{b}];" for at, (i, b) in enumerate(members)]
    textures = [
        f"[[vk::binding({2 + i}, 0)]] Texture2D<float4> {texture['name']};"
        for i, texture in enumerate(program["textures"])
    ]
    return "\n".join(
        [
            "[[vk::binding(0, 0)]] StructuredBuffer<float4> given;",
            "[[vk::binding(1, 0)]] RWStructuredBuffer<float4> result;",
            *textures,
            program["code"],
            "[numthreads(1, 1, 1)] void main(uint3 id : SV_DispatchThreadID) {",
            f"int base = int(id.x) * {given};",
            # A binding that a program does not use is not in the layout.
            "if (base < 0) { result[0] = given[0]; }",
            *body,
            "}",
        ]
    )


@functools.cache
def glslang_path() -> str:
    """glslang's compiler; raises where there is none."""
    return subprocess.run([ROOT / "tools/find-glslang.sh"], capture_output=True, text=True, check=True).stdout.strip()


def compiled(text: str, folder: Path, stage: str = "comp") -> bytes:
    """SPIR-V of an HLSL text; raises ``RuntimeError`` with what glslang says."""
    return _glslang(["-V", "-D", "-S", stage, "-e", "main"], text, folder)


def compiled_glsl(text: str, folder: Path, stage: str = "frag") -> bytes:
    """SPIR-V of a GLSL text; raises ``RuntimeError`` with what glslang says."""
    return _glslang(["-G", "-S", stage], text, folder)


def _glslang(options: list[str], text: str, folder: Path) -> bytes:
    source, binary = folder / "shader.txt", folder / "shader.spv"
    source.write_text(text)
    command = [glslang_path(), *options, "-o", str(binary), str(source)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stdout)
    return binary.read_bytes()


def rows(tensor: dict, points: int) -> np.ndarray:
    """A tensor of a vector file as [points, width]."""
    values = np.asarray(tensor["data"], np.float32).reshape(tensor["shape"])
    return np.broadcast_to(values, (points, values.shape[1]))


def in_blocks(values: np.ndarray) -> np.ndarray:
    """[N, width] with zeros behind, so that the width is a multiple of four."""
    return np.pad(values, ((0, 0), (0, -values.shape[1] % 4)))


class Runner:
    """A device of wgpu that runs compute shaders."""

    def __init__(self) -> None:
        adapter = wgpu.gpu.request_adapter_sync()
        if adapter is None:
            raise RuntimeError(
                "no adapter for wgpu; install mesa-vulkan-drivers (tools/find-glslang.sh --install does so)"
            )
        self.device = adapter.request_device_sync()

    def run(self, spirv: bytes, program: dict, inputs: np.ndarray, points: int) -> np.ndarray:
        """Outputs [points, 4 blocks] for the inputs [points, 4 blocks]."""
        device, usage = self.device, wgpu.BufferUsage
        width = 4 * sum(blocks(output["width"]) for output in program["outputs"])
        given = device.create_buffer_with_data(data=np.ascontiguousarray(inputs), usage=usage.STORAGE)
        result = device.create_buffer(size=4 * width * points, usage=usage.STORAGE | usage.COPY_SRC)
        resources = [{"buffer": given}, {"buffer": result}]
        resources += [self.texture(texture) for texture in program["textures"]]
        module = device.create_shader_module(code=spirv)
        pipeline = device.create_compute_pipeline(layout="auto", compute={"module": module, "entry_point": "main"})
        entries = [{"binding": i, "resource": resource} for i, resource in enumerate(resources)]
        group = device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)
        encoder = device.create_command_encoder()
        compute = encoder.begin_compute_pass()
        compute.set_pipeline(pipeline)
        compute.set_bind_group(0, group)
        compute.dispatch_workgroups(points)
        compute.end()
        device.queue.submit([encoder.finish()])
        return np.frombuffer(device.queue.read_buffer(result), np.float32).reshape(points, width)

    def texture(self, texture: dict):
        """A view of a printed texture of numbers."""
        size = (texture["width"], texture["height"], 1)
        usage = wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST
        made = self.device.create_texture(size=size, format=texture["format"], usage=usage)
        data = base64.b64decode(texture["data"])
        layout = {"bytes_per_row": len(data) // texture["height"]}
        self.device.queue.write_texture({"texture": made}, data, layout, size)
        return made.create_view()
