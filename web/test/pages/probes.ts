/** A page that asks probe volumes: on WebGL 2 and WebGPU as they are, and through three.js' two renderers. */

import { ProbeVolume, probesGlsl, probesWgsl } from "lightwell/probes";
import { ProbeVolumeLight } from "lightwell/probes/webgpu";
import { FloatType, Mesh, MeshStandardMaterial, OrthographicCamera, Scene, SphereGeometry, WebGLRenderer, WebGLRenderTarget } from "three";
import { MeshStandardNodeMaterial, RenderTarget, WebGPURenderer } from "three/webgpu";

export interface Asked {
  readonly file: string;
  readonly place: number[][];
  readonly normal: number[][];
  /** Times that the queries are repeated, for a timing. */
  readonly repeat?: number;
  readonly mode?: number;
}

export interface Told {
  /** Four numbers a query: irradiance and trust. */
  readonly data: number[];
  readonly milliseconds: number;
}

const volumeOf = (file: string) => new ProbeVolume(Uint8Array.from(atob(file), (c) => c.charCodeAt(0)).buffer as ArrayBuffer);

const fours = (rows: number[][]) => new Float32Array(rows.flatMap((row) => [...row, 0]));

function compile(gl: WebGL2RenderingContext, fragment: string): WebGLProgram {
  const program = gl.createProgram();
  const vertex = "#version 300 es\nvoid main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }";
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]] as const) {
    const shader = gl.createShader(kind)!;
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? "shader");
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return program;
}

async function webgl({ file, place, normal, repeat = 1, mode = 0 }: Asked): Promise<Told> {
  const volume = volumeOf(file);
  const gl = document.createElement("canvas").getContext("webgl2")!;
  gl.getExtension("EXT_color_buffer_float");
  const [width, rows] = [place.length, repeat];
  const program = compile(
    gl,
    `#version 300 es
precision highp float; precision highp int; precision highp usampler2D;
uniform usampler2D v_words; uniform sampler2D places, normals; out vec4 color;
${probesGlsl(volume.file, "v")}
void main() { v_mode = ${mode}; ivec2 at = ivec2(int(gl_FragCoord.x), 0);
  color = v(texelFetch(places, at, 0).xyz, texelFetch(normals, at, 0).xyz); }`,
  );
  const bind = (unit: number, name: string, make: () => void) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    make();
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
    gl.uniform1i(gl.getUniformLocation(program, name), unit);
  };
  gl.useProgram(program);
  const { data, width: w, height: h } = volume.texture.image as { data: Uint32Array; width: number; height: number };
  bind(0, "v_words", () => gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32UI, w, h, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, data));
  bind(1, "places", () => gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, 1, 0, gl.RGBA, gl.FLOAT, fours(place)));
  bind(2, "normals", () => gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, 1, 0, gl.RGBA, gl.FLOAT, fours(normal)));
  bind(3, "", () => gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, rows, 0, gl.RGBA, gl.FLOAT, null));
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, gl.getParameter(gl.TEXTURE_BINDING_2D), 0);
  gl.viewport(0, 0, width, rows);
  const out = new Float32Array(4 * width);
  const draw = () => {
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.readPixels(0, 0, width, 1, gl.RGBA, gl.FLOAT, out);
  };
  draw();
  const start = performance.now();
  draw();
  const milliseconds = performance.now() - start;
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return { data: [...out], milliseconds };
}

async function webgpu({ file, place, normal }: Asked): Promise<Told> {
  const volume = volumeOf(file);
  const device = await (await navigator.gpu.requestAdapter())!.requestDevice();
  const { data, width, height } = volume.texture.image as { data: Uint32Array<ArrayBuffer>; width: number; height: number };
  const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
  const words = device.createTexture({ size: [width, height], format: "rgba32uint", usage });
  device.queue.writeTexture({ texture: words }, data, { bytesPerRow: 16 * width }, [width, height]);
  const code = `
@group(0) @binding(0) var v_words: texture_2d<u32>;
@group(0) @binding(1) var<storage, read> places: array<vec4f>;
@group(0) @binding(2) var<storage, read> normals: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> out: array<vec4f>;
${probesWgsl(volume.file, "v")}
@compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {
  if (id.x < arrayLength(&out)) { out[id.x] = v(places[id.x].xyz, normals[id.x].xyz); }
}`;
  const pipeline = device.createComputePipeline({ layout: "auto", compute: { module: device.createShaderModule({ code }) } });
  const size = 16 * place.length;
  const buffers = [place, normal].map((rows) => {
    const buffer = device.createBuffer({ size, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST });
    device.queue.writeBuffer(buffer, 0, fours(rows));
    return buffer;
  });
  const out = device.createBuffer({ size, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC });
  const back = device.createBuffer({ size, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
  const entries = [...buffers, out].map((buffer, k) => ({ binding: k + 1, resource: { buffer } }));
  const group = device.createBindGroup({
    layout: pipeline.getBindGroupLayout(0),
    entries: [{ binding: 0, resource: words.createView() }, ...entries],
  });
  const encoder = device.createCommandEncoder();
  const pass = encoder.beginComputePass();
  pass.setPipeline(pipeline);
  pass.setBindGroup(0, group);
  pass.dispatchWorkgroups(Math.ceil(place.length / 64));
  pass.end();
  encoder.copyBufferToBuffer(out, 0, back, 0, size);
  const start = performance.now();
  device.queue.submit([encoder.finish()]);
  await back.mapAsync(GPUMapMode.READ);
  const found = [...new Float32Array(back.getMappedRange())];
  device.destroy();
  return { data: found, milliseconds: performance.now() - start };
}

const SIZE = 48;

/** Linear RGBA of a white ball of 0.8 m at a place, lit by a volume alone; seen from +z. */
async function ball(kind: "webgl" | "webgpu" | "fallback", file: string, place: [number, number, number]): Promise<number[]> {
  const volume = volumeOf(file);
  const [scene, camera] = [new Scene(), new OrthographicCamera(-0.5, 0.5, 0.5, -0.5, 0.1, 4)];
  const look = { color: 0xffffff, roughness: 1, metalness: 0 };
  const material = kind === "webgl" ? new MeshStandardMaterial(look) : new MeshStandardNodeMaterial(look);
  const mesh = new Mesh(new SphereGeometry(0.4, 48, 24), material);
  mesh.position.set(...place);
  camera.position.set(place[0], place[1], place[2] + 2);
  scene.add(mesh);
  if (kind === "webgl") {
    volume.light(material);
    const renderer = new WebGLRenderer();
    const target = new WebGLRenderTarget(SIZE, SIZE, { type: FloatType });
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    const out = new Float32Array(4 * SIZE * SIZE);
    renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, out);
    renderer.dispose();
    return [...out];
  }
  scene.add(new ProbeVolumeLight(volume));
  const renderer = new WebGPURenderer({ forceWebGL: kind === "fallback" });
  await renderer.init();
  if (kind === "webgpu" && !(renderer.backend as { isWebGPUBackend?: boolean }).isWebGPUBackend) throw new Error("no WebGPU");
  const target = new RenderTarget(SIZE, SIZE, { type: FloatType });
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  const out = await renderer.readRenderTargetPixelsAsync(target, 0, 0, SIZE, SIZE);
  renderer.dispose();
  return [...(out as Float32Array)];
}

const page = { webgl, webgpu, ball };
declare global {
  interface Window {
    probes: typeof page;
  }
}
window.probes = page;
