"""How long the lens takes on a GPU at 1024x1024 with two layers: the WGSL that the browser runs, through wgpu.

A stage of gpu.py (``--only lens``). The page's own plan of buffers, shaders and steps (web/runtime/src/lens/plan.ts)
is printed by Node and carried out here, so that there is one program. The frame has a ramp of blur up to 32 px behind
focus and bars 20 px before it; gathering, the cut between the layers, the fill behind the front one, both scatters,
both solves and the composite are inside the time. Its picture is compared with the Python pipeline's. Needs
`pip install -e ".[gpu]"` (wgpu), a Vulkan, Metal or D3D12 driver, and Node and the web's packages or programs that were
prepared. With ``--simulate`` a software rasteriser runs a small frame.
"""

from __future__ import annotations

import base64
import time
from pathlib import Path
from statistics import median

import numpy as np
from gpu_figures import Record
from gpu_programs import lens_plan
from gpu_shading import adapter, is_software

from lightwell.lens.camera import LensCamera
from lightwell.lens.pipeline import Lens
from lightwell.lens.settings import LensSettings

ROOT = Path(__file__).resolve().parents[1]
DISC = ROOT / "lightwell/lens/standard/disc-32.lwsp"
SIZE, SIMULATED_SIZE, LARGEST = 1024, 128, 32.0
FRAMES, SIMULATED_FRAMES = 30, 2
# Bytes of a row of a texture that is copied to a buffer are a multiple of this (WebGPU).
ROW_ALIGNMENT = 256
KINDS = {
    "uniform": {"buffer": {"type": "uniform"}},
    "read": {"buffer": {"type": "read-only-storage"}},
    "write": {"buffer": {"type": "storage"}},
    "texture": {"texture": {"sample_type": "unfilterable-float"}},
    "picture": {"storage_texture": {"access": "write-only", "format": "rgba32float"}},
}


def frame(size: int) -> tuple[np.ndarray, np.ndarray, LensCamera]:
    """rgb [size, size, 3], depth [size, size] and the camera: a checkered ramp behind bars."""
    y, x = np.mgrid[:size, :size]
    unit = LensCamera(focus=2.0, fstop=1.0, focal=0.05)
    camera = LensCamera(focus=2.0, focal=0.05, fstop=float(unit.strength(size) * (1 / 2.0) / LARGEST))
    kc = camera.strength(size)
    depth = 1 / np.maximum(0.5 - (x / (size - 1) * LARGEST) / kc, 1e-9)
    rgb = (0.2 + 0.6 * (((x // 16) + (y // 16)) % 2))[..., None] * np.array([1, 0.8, 0.6])
    bars = (x + y // 3) % (size // 6) < size // 20
    depth[bars], rgb[bars] = 1 / (0.5 + 20 / kc), [0.7, 0.2, 0.1]
    return rgb.astype(np.float32), depth.astype(np.float32), camera


def job_of(size: int, camera: LensCamera, software: bool) -> dict:
    """The job for which tools/print-lens.mjs prints the plan."""
    options = {
        "width": size, "height": size, "layers": 2, "largest": min(LARGEST, size / 2), "longest": 1, "extend": True,
        "format": "rgba32float", "software": software,
    }  # fmt: skip
    facts = {
        "depthMeaning": {"kind": "linear"}, "motion": False, "edges": "extend", "tolerance": 1e-3,
        "camera": {n: float(getattr(camera, n)) for n in ("focus", "focal", "fstop", "sensor")},
    }  # fmt: skip
    return {"still": str(DISC), "moving": None, "options": options, "frame": facts}


class Program:
    """The plan on a device."""

    def __init__(self, found, plan: dict, rgb: np.ndarray, depth: np.ndarray) -> None:
        import wgpu

        self.plan, self.size = plan, depth.shape[0]
        self.timestamps = "timestamp-query" in found.features
        names = ("max-storage-buffer-binding-size", "max-buffer-size")
        self.device = found.request_device_sync(
            required_features=["timestamp-query"] if self.timestamps else [],
            required_limits={n: found.limits[n] for n in names},
        )
        rgba = np.concatenate([rgb, np.ones((*depth.shape, 1), np.float32)], -1)
        read, write = wgpu.TextureUsage.TEXTURE_BINDING, wgpu.TextureUsage.STORAGE_BINDING | wgpu.TextureUsage.COPY_SRC
        self.textures = {
            "color": self._texture("rgba32float", read, rgba),
            "depth": self._texture("r32float", read, depth),
            "motion": self._texture("rg32float", read, np.zeros((1, 1, 2), np.float32)),
            "picture": self._texture("rgba32float", write, None),
        }
        self.buffers = {name: self._buffer(one) for name, one in plan["buffers"].items()}
        start = time.perf_counter()
        stages = {name: self._stage(shader) for name, shader in plan["shaders"].items()}
        self.compile_seconds = time.perf_counter() - start
        self.steps = [
            self.buffers[step["clear"]]
            if "clear" in step
            else (stages[step["shader"]][1], self._group(stages[step["shader"]][0], step["uses"]), step["groups"])
            for step in plan["steps"]
        ]

    def _texture(self, format: str, usage: int, pixels: np.ndarray | None):
        import wgpu

        height, width = (self.size, self.size) if pixels is None else pixels.shape[:2]
        size = (width, height, 1)
        texture = self.device.create_texture(size=size, format=format, usage=usage | wgpu.TextureUsage.COPY_DST)
        if pixels is not None:
            pixels = np.ascontiguousarray(pixels, np.float32)
            layout = {"offset": 0, "bytes_per_row": pixels[0].nbytes, "rows_per_image": height}
            self.device.queue.write_texture({"texture": texture}, pixels, layout, size)
        return texture

    def _buffer(self, one: dict):
        import wgpu

        use = wgpu.BufferUsage
        usage = use.STORAGE | use.UNIFORM | use.COPY_DST | use.COPY_SRC
        buffer = self.device.create_buffer(size=-(-one["bytes"] // 16) * 16, usage=usage)
        if one["data"]:
            self.device.queue.write_buffer(buffer, 0, base64.b64decode(one["data"]))
        return buffer

    def _stage(self, shader: dict):
        import wgpu

        stage = wgpu.ShaderStage.COMPUTE
        entries = [{"binding": i, "visibility": stage, **KINDS[kind]} for i, kind in enumerate(shader["bindings"])]
        layout = self.device.create_bind_group_layout(entries=entries)
        pipeline = self.device.create_compute_pipeline(
            layout=self.device.create_pipeline_layout(bind_group_layouts=[layout]),
            compute={"module": self.device.create_shader_module(code=shader["code"]), "entry_point": "main"},
        )
        return layout, pipeline

    def _group(self, layout, uses: list[str]):
        entries = []
        for i, name in enumerate(uses):
            if name in self.textures:
                resource = self.textures[name].create_view()
            else:
                buffer = self.buffers[name]
                resource = {"buffer": buffer, "offset": 0, "size": buffer.size}
            entries.append({"binding": i, "resource": resource})
        return self.device.create_bind_group(layout=layout, entries=entries)

    def _encode(self, encoder, queries=None) -> None:
        """All steps; with queries the first pass and the last one say when they began and ended."""
        runs, current = [], []
        for step in self.steps:
            if isinstance(step, tuple):
                current.append(step)
            else:
                runs.append((current, step))
                current = []
        runs.append((current, None))
        first, last = (pick([i for i, (run, _) in enumerate(runs) if run]) for pick in (min, max))
        for number, (run, cleared) in enumerate(runs):
            if run:
                writes = {}
                if queries and number == first:
                    writes["beginning_of_pass_write_index"] = 0
                if queries and number == last:
                    writes["end_of_pass_write_index"] = 1
                options = {"timestamp_writes": {"query_set": queries, **writes}} if writes else {}
                compute = encoder.begin_compute_pass(**options)
                for pipeline, group, groups in run:
                    compute.set_pipeline(pipeline)
                    compute.set_bind_group(0, group)
                    compute.dispatch_workgroups(*groups)
                compute.end()
            if cleared is not None:
                encoder.clear_buffer(cleared)

    def picture(self) -> np.ndarray:
        """[size, size, 4] float32 of one frame."""
        encoder = self.device.create_command_encoder()
        self._encode(encoder)
        self.device.queue.submit([encoder.finish()])
        pitch = -(-self.size * 16 // ROW_ALIGNMENT) * ROW_ALIGNMENT
        layout = {"offset": 0, "bytes_per_row": pitch, "rows_per_image": self.size}
        data = self.device.queue.read_texture({"texture": self.textures["picture"]}, layout, (self.size, self.size, 1))
        rows = np.frombuffer(data, np.float32).reshape(self.size, pitch // 4)[:, : 4 * self.size]
        return rows.reshape(self.size, self.size, 4)

    def seconds(self) -> float:
        """One frame, by the GPU's clock where it has one, else by the wall's."""
        import wgpu

        device, encoder = self.device, self.device.create_command_encoder()
        fence = device.create_buffer(size=16, usage=wgpu.BufferUsage.COPY_SRC | wgpu.BufferUsage.COPY_DST)
        queries = device.create_query_set(type="timestamp", count=2) if self.timestamps else None
        self._encode(encoder, queries)
        if queries:
            usage = wgpu.BufferUsage.QUERY_RESOLVE | wgpu.BufferUsage.COPY_SRC
            result = device.create_buffer(size=16, usage=usage)
            encoder.resolve_query_set(queries, 0, 2, result, 0)
        start = time.perf_counter()
        device.queue.submit([encoder.finish()])
        device.queue.read_buffer(fence)
        wall = time.perf_counter() - start
        if not queries:
            return wall
        begin, end = np.frombuffer(device.queue.read_buffer(result), np.uint64).astype(np.int64)
        return float(end - begin) * 1e-9


def measure(record: Record, simulate: bool) -> None:
    """Record the time, and the agreement with Python."""
    found = adapter(simulate)
    info = dict(found.info)
    software, size = is_software(info), SIMULATED_SIZE if simulate else SIZE
    rgb, depth, camera = frame(size)
    program = Program(found, lens_plan(job_of(size, camera, software), size, software), rgb, depth)
    expected, report = Lens(LensSettings(layers=2)).apply(rgb, depth, None, camera)
    error = np.mean((np.clip(program.picture()[..., :3], 0, 1) - np.clip(expected[..., :3], 0, 1)) ** 2)
    record("parity", float(-10 * np.log10(error)), f"{size}x{size}, {report.line()}")
    times = [program.seconds() for _ in range(SIMULATED_FRAMES if simulate else FRAMES)]
    ms = 1e3 * median(times[1:])
    clock = "GPU timestamps" if program.timestamps else "wall clock"
    note = f"{info['device']} ({info['backend_type']}), {size}x{size}, {clock}: {ms:.4g} ms"
    note += f"; compiled in {program.compile_seconds:.1f} s; the paper: 190 ms on a GTX 980 Ti"
    record("frame", ms, note)
