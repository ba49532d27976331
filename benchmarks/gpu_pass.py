"""A full-screen pass over a G-buffer through wgpu, as fragments or as a compute shader: what a frame asks of a field.

The G-buffer holds what real ones hold: position and roughness in 32-bit floats, normal and metallic in half floats,
reflectance in 8 bits. ``GBuffer.inputs`` are the same rounded numbers, for NumPy.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from statistics import median
from typing import Any, Literal

import numpy as np
import wgpu
from wgsl import Program

from lightwell.scenes.scene import Camera, Scene
from lightwell.transport import gbuffer, make_query

# Where a pass runs. A renderer shades in either; of data-centre GPUs only a few cores run fragments.
Stage = Literal["fragment", "compute"]
VISIBLE = wgpu.ShaderStage.FRAGMENT | wgpu.ShaderStage.COMPUTE
# Bytes of a row of a texture that is copied to a buffer are a multiple of this (WebGPU).
ROW_ALIGNMENT = 256
# Warm-up before the clock counts, seconds: clocks of an idle GPU rise and pipelines settle.
WARM_UP = 0.3
# Passes between two fences, where there is no clock on the GPU.
FRAMES = 8

# Second texture coordinates per metre, in place of an atlas: neighbouring pixels read neighbouring texels, as there.
UV_SCALE = 0.25

VERTEX = """
@vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
  return vec4f(vec2f(f32(i & 1u), f32(i >> 1u)) * 4.0 - 1.0, 0.0, 1.0);
}
struct Frame { eye: vec4f, light: vec4f }
@group(0) @binding(0) var position_map: texture_2d<f32>;
@group(0) @binding(1) var normal_map: texture_2d<f32>;
@group(0) @binding(2) var reflectance_map: texture_2d<f32>;
@group(0) @binding(3) var<uniform> frame: Frame;
"""
SHADED = """
fn shaded(pixel: vec2i) -> vec4f {
  let p = textureLoad(position_map, pixel, 0);
  let n = textureLoad(normal_map, pixel, 0);
  let a = textureLoad(reflectance_map, pixel, 0);
  let position = p.xyz;
  let roughness = p.w;
  let normal = n.xyz;
  let metallic = n.w;
  let reflectance = max(a.xyz, vec3f(0.001));
  let view = normalize(frame.eye.xyz - position);
  let light = frame.light.xyz;
  let shading_normal = normal;
  let uv1 = position.xz * UV_SCALE + 0.5;
  return vec4f(BODY, 1.0);
}
"""
FRAGMENT = """
@fragment fn shade(@builtin(position) at: vec4f) -> @location(0) vec4f { return shaded(vec2i(at.xy)); }
"""
# Pixels of a workgroup, across and down.
TILE = (8, 8)
COMPUTE = """
@group(GROUP) @binding(0) var target_map: texture_storage_2d<FORMAT, write>;
@compute @workgroup_size(TILE) fn shade(@builtin(global_invocation_id) at: vec3u) {
  let pixel = vec2i(at.xy);
  if (all(at.xy < textureDimensions(target_map))) { textureStore(target_map, pixel, shaded(pixel)); }
}
"""
# What every renderer does anyway: read the same G-buffer and put its texture on the screen, lit from the eye.
TEXTURED = "reflectance * (0.5 + 0.5 * max(dot(normal, view), 0.0)) * (1.0 + 0.0 * (roughness + metallic))"


@dataclass(frozen=True)
class GBuffer:
    """What the pixels show. H x W pixels, first row at the top."""

    position: np.ndarray
    """[H, W, 4] float32: position, roughness; a pixel without a surface repeats one that has it."""
    normal: np.ndarray
    """[H, W, 4] float16: normal, metallic."""
    reflectance: np.ndarray
    """[H, W, 4] uint8."""
    eye: np.ndarray
    """[3] metres."""
    light: np.ndarray
    """[3]."""

    @property
    def inputs(self) -> dict[str, np.ndarray]:
        """Inputs of a shading graph at all pixels, [H W, C] each, ``light`` [1, 3]."""
        rows = lambda a: a.reshape(-1, a.shape[-1]).astype(np.float32)  # noqa: E731
        position, normal = rows(self.position), rows(self.normal)
        view = self.eye.astype(np.float32) - position[:, :3]
        return {
            "position": position[:, :3],
            "normal": normal[:, :3],
            "view": view / np.linalg.norm(view, axis=1, keepdims=True),
            "light": self.light.astype(np.float32)[None],
            "reflectance": np.maximum(rows(self.reflectance)[:, :3] / np.float32(255), np.float32(1e-3)),
            "roughness": position[:, 3:],
            "metallic": normal[:, 3:],
            "shading_normal": normal[:, :3],
            "uv1": position[:, [0, 2]] * np.float32(UV_SCALE) + np.float32(0.5),
        }


def make_gbuffer(scene: Scene, camera: Camera, light: np.ndarray, size: tuple[int, int]) -> GBuffer:
    """Rasterise by ray casting through pixel centres; ``size`` = (width, height)."""
    width, height = size
    points, mask, _ = gbuffer(scene, camera, width, height)
    if not mask.any():
        raise ValueError("gpu shading: the camera sees no surface")
    # The sky costs what a wall costs: a pixel without a surface takes the last one that has it.
    source = np.maximum.accumulate(np.where(mask, np.arange(len(mask)), 0))
    source = np.where(mask[source], source, np.flatnonzero(mask)[0])
    query = make_query(scene, points[source], light)
    image = lambda *columns: np.concatenate(columns, axis=1).reshape(height, width, 4)  # noqa: E731
    reflectance = np.rint(np.clip(query.reflectance, 0, 1) * 255)
    return GBuffer(
        position=image(query.position, query.roughness).astype(np.float32),
        normal=image(query.normal, query.metallic).astype(np.float16),
        reflectance=image(reflectance, np.full((len(reflectance), 1), 255)).astype(np.uint8),
        eye=np.asarray(camera.position, np.float32),
        light=np.asarray(light, np.float32),
    )


class Gpu:
    """A device with a G-buffer on it, ready to time passes."""

    def __init__(self, adapter: Any, buffer: GBuffer) -> None:
        self.timestamps = "timestamp-query" in adapter.features
        self.device = adapter.request_device_sync(required_features=["timestamp-query"] if self.timestamps else [])
        self.height, self.width = buffer.position.shape[:2]
        layers = {"rgba32float": buffer.position, "rgba16float": buffer.normal, "rgba8unorm": buffer.reflectance}
        views = [self._texture(format, pixels).create_view() for format, pixels in layers.items()]
        frame = np.concatenate([buffer.eye, [0], buffer.light, [0]]).astype(np.float32)
        uniform = self.device.create_buffer_with_data(data=frame.tobytes(), usage=wgpu.BufferUsage.UNIFORM)
        resources = [*views, {"buffer": uniform, "offset": 0, "size": frame.nbytes}]
        stage = VISIBLE
        texture = {"sample_type": "unfilterable-float"}
        kinds = [{"texture": texture}] * 3 + [{"buffer": {"type": "uniform"}}]
        entries = [{"binding": k, "visibility": stage, **kind} for k, kind in enumerate(kinds)]
        self._layout = self.device.create_bind_group_layout(entries=entries)
        bound = [{"binding": k, "resource": resource} for k, resource in enumerate(resources)]
        self._group = self.device.create_bind_group(layout=self._layout, entries=bound)

    def _texture(self, format: str, pixels: np.ndarray) -> Any:
        size = (self.width, self.height, 1)
        usage = wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST
        texture = self.device.create_texture(size=size, format=format, usage=usage)
        layout = {"offset": 0, "bytes_per_row": pixels[0].nbytes, "rows_per_image": self.height}
        pixels = np.ascontiguousarray(pixels)
        self.device.queue.write_texture({"texture": texture}, pixels, layout, size)
        return texture

    def prepare(self, program: Program | None, stage: Stage) -> Pass:
        """The pass of a field, or of a plain texture for None."""
        return Pass(self, program, stage)


class Pass:
    """One full-screen pass, compiled for a target that is shown (half floats) and one that is compared (floats)."""

    def __init__(self, gpu: Gpu, program: Program | None, stage: Stage) -> None:
        self.gpu, self.stage = gpu, stage
        body = f"field({', '.join(program.parameters)}) * reflectance" if program else TEXTURED
        field = program.code if program else ""
        shaded = SHADED.replace("BODY", body).replace("UV_SCALE", f"{UV_SCALE}")
        self._code = VERTEX + field + shaded
        self._groups, self._layouts = [gpu._group], [gpu._layout]
        bounds = [(b, kind) for b, kind in self._bounds(program) if b is not None]
        if bounds:
            layout, group = self._bind(bounds)
            self._layouts.append(layout)
            self._groups.append(group)
        start = time.perf_counter()
        self._shown = self._pipeline("rgba16float")
        self.compile_seconds = time.perf_counter() - start
        self._target = self._make_target("rgba16float")

    @staticmethod
    def _bounds(program: Program | None) -> list:
        return [(program.weights, "read-only-storage"), (program.frame, "uniform")] if program else []

    def _bind(self, bounds: list) -> tuple[Any, Any]:
        device, stage = self.gpu.device, VISIBLE
        usage = {"read-only-storage": wgpu.BufferUsage.STORAGE, "uniform": wgpu.BufferUsage.UNIFORM}
        kinds = [{"binding": b.binding, "visibility": stage, "buffer": {"type": kind}} for b, kind in bounds]
        layout = device.create_bind_group_layout(entries=kinds)
        entries = []
        for b, kind in bounds:
            buffer = device.create_buffer_with_data(data=b.data.tobytes(), usage=usage[kind])
            entries.append({"binding": b.binding, "resource": {"buffer": buffer, "offset": 0, "size": b.data.nbytes}})
        return layout, device.create_bind_group(layout=layout, entries=entries)

    def _pipeline(self, format: str) -> Any:
        device, layouts = self.gpu.device, list(self._layouts)
        if self.stage == "compute":
            layouts.append(self._target_layout(format))
            entry = (
                COMPUTE.replace("GROUP", f"{len(self._groups)}")
                .replace("FORMAT", format)
                .replace("TILE", f"{TILE[0]}, {TILE[1]}")
            )
            module = device.create_shader_module(code=self._code + entry)
            layout = device.create_pipeline_layout(bind_group_layouts=layouts)
            return device.create_compute_pipeline(layout=layout, compute={"module": module, "entry_point": "shade"})
        module = device.create_shader_module(code=self._code + FRAGMENT)
        return device.create_render_pipeline(
            layout=device.create_pipeline_layout(bind_group_layouts=layouts),
            vertex={"module": module, "entry_point": "corner"},
            primitive={"topology": "triangle-list"},
            fragment={"module": module, "entry_point": "shade", "targets": [{"format": format}]},
        )

    def _target_layout(self, format: str) -> Any:
        storage = {"access": "write-only", "format": format}
        entry = {"binding": 0, "visibility": wgpu.ShaderStage.COMPUTE, "storage_texture": storage}
        return self.gpu.device.create_bind_group_layout(entries=[entry])

    def _make_target(self, format: str) -> Any:
        usage = wgpu.TextureUsage.COPY_SRC
        usage |= wgpu.TextureUsage.STORAGE_BINDING if self.stage == "compute" else wgpu.TextureUsage.RENDER_ATTACHMENT
        return self.gpu.device.create_texture(size=(self.gpu.width, self.gpu.height, 1), format=format, usage=usage)

    def _encode(self, encoder: Any, pipeline: Any, target: Any, timestamps: dict | None = None) -> None:
        options = {"timestamp_writes": timestamps} if timestamps else {}
        if self.stage == "compute":
            layout = self._target_layout(target.format)
            entry = {"binding": 0, "resource": target.create_view()}
            groups = [*self._groups, self.gpu.device.create_bind_group(layout=layout, entries=[entry])]
            work = encoder.begin_compute_pass(**options)
        else:
            groups = self._groups
            attachment = {"view": target.create_view(), "load_op": "clear", "store_op": "store"}
            work = encoder.begin_render_pass(color_attachments=[attachment], **options)
        work.set_pipeline(pipeline)
        for k, group in enumerate(groups):
            work.set_bind_group(k, group)
        if self.stage == "compute":
            work.dispatch_workgroups(-(-self.gpu.width // TILE[0]), -(-self.gpu.height // TILE[1]))
        else:
            work.draw(3)
        work.end()

    # ------------------------------------------------------------------ what it computes

    def picture(self) -> np.ndarray:
        """[H, W, 3] float32 radiance of one frame."""
        gpu, target = self.gpu, self._make_target("rgba32float")
        pipeline, encoder = self._pipeline("rgba32float"), gpu.device.create_command_encoder()
        self._encode(encoder, pipeline, target)
        gpu.device.queue.submit([encoder.finish()])
        pitch = -(-gpu.width * 16 // ROW_ALIGNMENT) * ROW_ALIGNMENT
        layout = {"offset": 0, "bytes_per_row": pitch, "rows_per_image": gpu.height}
        size = (gpu.width, gpu.height, 1)
        data = gpu.device.queue.read_texture({"texture": target}, layout, size)
        rows = np.frombuffer(data, np.float32).reshape(gpu.height, pitch // 4)[:, : 4 * gpu.width]
        return rows.reshape(gpu.height, gpu.width, 4)[..., :3]

    # ------------------------------------------------------------------ how long it takes

    def seconds(self, rounds: int) -> float:
        """Median time of one pass: by the GPU's own clock where it has one, else by frames between two fences."""
        end = time.perf_counter() + WARM_UP
        self._frames(1)
        while time.perf_counter() < end:
            self._frames(1)
        if self.gpu.timestamps:
            return median(self._timestamped() for _ in range(rounds))
        return median(self._frames(FRAMES) for _ in range(rounds))

    def _frames(self, count: int) -> float:
        """Seconds of a pass, by the wall clock around ``count`` submitted passes and a read-back."""
        device = self.gpu.device
        fence = device.create_buffer(size=16, usage=wgpu.BufferUsage.COPY_SRC | wgpu.BufferUsage.COPY_DST)
        start = time.perf_counter()
        for _ in range(count):
            encoder = device.create_command_encoder()
            self._encode(encoder, self._shown, self._target)
            device.queue.submit([encoder.finish()])
        device.queue.read_buffer(fence)
        return (time.perf_counter() - start) / count

    def _timestamped(self) -> float:
        """Seconds between the begin and the end of a pass on the GPU's clock, which counts nanoseconds."""
        device = self.gpu.device
        queries = device.create_query_set(type="timestamp", count=2)
        usage = wgpu.BufferUsage.QUERY_RESOLVE | wgpu.BufferUsage.COPY_SRC
        result = device.create_buffer(size=16, usage=usage)
        writes = {"query_set": queries, "beginning_of_pass_write_index": 0, "end_of_pass_write_index": 1}
        encoder = device.create_command_encoder()
        self._encode(encoder, self._shown, self._target, writes)
        encoder.resolve_query_set(queries, 0, 2, result, 0)
        device.queue.submit([encoder.finish()])
        first, last = np.frombuffer(device.queue.read_buffer(result), np.uint64).astype(np.int64)
        return float(last - first) * 1e-9
