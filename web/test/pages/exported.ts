/** Runs exported shader texts as a host would, one fragment a point; self-contained, because Playwright sends the text. */

export interface ExportedJob {
  readonly text: string;
  readonly name: string;
  /** Inputs in the order of the function's parameters: width, and values [points][width]. */
  readonly inputs: { readonly width: number; readonly rows: number[][] }[];
  readonly tables: { readonly name: string; readonly format: string; readonly width: number; readonly height: number; readonly data: number[] }[];
  /** Encoded images by uniform, in the order of their bindings. */
  readonly pictures: { readonly name: string; readonly mime: string; readonly base64: string }[];
}

/** GLSL: RGB at every point. */
export async function runExportedGlsl(job: ExportedJob): Promise<number[][]> {
  const points = job.inputs[0]!.rows.length;
  const canvas = new OffscreenCanvas(points, 1);
  const gl = canvas.getContext("webgl2")!;
  if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("no float targets");
  const compile = (type: number, text: string) => {
    const shader = gl.createShader(type)!;
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? "compile");
    return shader;
  };
  const swizzle = ["", ".x", ".xy", ".xyz", ""];
  const call = job.inputs.map(({ width }, i) => `texelFetch(inputs, ivec2(gl_FragCoord.x, ${i}), 0)${swizzle[width]}`);
  const program = gl.createProgram();
  gl.attachShader(program, compile(gl.VERTEX_SHADER, "#version 300 es\nvoid main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }"));
  gl.attachShader(
    program,
    compile(
      gl.FRAGMENT_SHADER,
      `#version 300 es\nprecision highp float;\nprecision highp int;\nuniform highp sampler2D inputs;\nout vec4 color;\n${job.text}\nvoid main() { color = vec4(${job.name}(${call.join(", ")}), 1.0); }`,
    ),
  );
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "link");
  gl.useProgram(program);
  let unit = 0;
  const bind = (name: string, filter: number, upload: () => void) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    upload();
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, filter);
    for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
    gl.uniform1i(gl.getUniformLocation(program, name), unit++);
  };
  const packed = new Float32Array(4 * points * job.inputs.length);
  job.inputs.forEach(({ rows }, i) => {
    rows.forEach((row, p) => packed.set(row, 4 * (i * points + p)));
  });
  bind("inputs", gl.NEAREST, () =>
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, points, job.inputs.length, 0, gl.RGBA, gl.FLOAT, packed),
  );
  for (const { name, format, width, height, data } of job.tables) {
    bind(name, gl.NEAREST, () =>
      format === "rgba16float"
        ? gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, width, height, 0, gl.RGBA, gl.HALF_FLOAT, Uint16Array.from(data))
        : gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, Float32Array.from(data)),
    );
  }
  for (const { name, mime, base64 } of job.pictures) {
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], { type: mime }), { premultiplyAlpha: "none", colorSpaceConversion: "none" });
    bind(name, gl.LINEAR, () => gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image));
  }
  gl.activeTexture(gl.TEXTURE0 + unit);
  const target = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, target);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, points, 1, 0, gl.RGBA, gl.FLOAT, null);
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, points, 1);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const values = new Float32Array(4 * points);
  gl.readPixels(0, 0, points, 1, gl.RGBA, gl.FLOAT, values);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return Array.from({ length: points }, (_, p) => [...values.slice(4 * p, 4 * p + 3)]);
}

/** WGSL in a fragment shader: RGB at every point. */
export async function runExportedWgsl(job: ExportedJob): Promise<number[][]> {
  const points = job.inputs[0]!.rows.length;
  const adapter = await navigator.gpu.requestAdapter();
  const device = await adapter!.requestDevice();
  const swizzle = ["", ".x", ".xy", ".xyz", ""];
  const call = job.inputs.map(({ width }, i) => `inputs[${i * points}u + u32(at.x)]${swizzle[width]}`);
  const code = `${job.text}
@group(1) @binding(0) var<storage, read> inputs: array<vec4f>;
@vertex fn vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
  return vec4f(vec2f(f32(i & 1u), f32(i >> 1u)) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment fn fragment(@builtin(position) at: vec4f) -> @location(0) vec4f { return vec4f(${job.name}(${call.join(", ")}), 1.0); }`;
  device.pushErrorScope("validation");
  const module = device.createShaderModule({ code });
  const { messages } = await module.getCompilationInfo();
  if (messages.some((m) => m.type === "error")) throw new Error(messages.map((m) => m.message).join("\n"));
  const pipeline = device.createRenderPipeline({
    layout: "auto",
    vertex: { module },
    fragment: { module, targets: [{ format: "rgba32float" }] },
  });
  const storage = (data: Float32Array<ArrayBuffer>) => {
    const buffer = device.createBuffer({ size: data.byteLength, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST });
    device.queue.writeBuffer(buffer, 0, data);
    return { buffer };
  };
  const own: GPUBindGroupEntry[] = job.tables.map(({ data }) => ({ binding: 0, resource: storage(Float32Array.from(data)) }));
  for (const [i, { mime, base64 }] of job.pictures.entries()) {
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], { type: mime }), { premultiplyAlpha: "none", colorSpaceConversion: "none" });
    const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST | GPUTextureUsage.RENDER_ATTACHMENT;
    const texture = device.createTexture({ size: [image.width, image.height], format: "rgba8unorm", usage });
    device.queue.copyExternalImageToTexture({ source: image }, { texture }, [image.width, image.height]);
    own.push({ binding: 2 + 2 * i, resource: texture.createView() });
    own.push({ binding: 3 + 2 * i, resource: device.createSampler({ magFilter: "linear", minFilter: "linear" }) });
  }
  const packed = new Float32Array(4 * points * job.inputs.length);
  job.inputs.forEach(({ rows }, i) => {
    rows.forEach((row, p) => packed.set(row, 4 * (i * points + p)));
  });
  const target = device.createTexture({ size: [points, 1], format: "rgba32float", usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC });
  const bytesPerRow = Math.ceil((16 * points) / 256) * 256;
  const read = device.createBuffer({ size: bytesPerRow, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
  const encoder = device.createCommandEncoder();
  const pass = encoder.beginRenderPass({ colorAttachments: [{ view: target.createView(), loadOp: "clear", storeOp: "store" }] });
  pass.setPipeline(pipeline);
  if (own.length) pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries: own }));
  pass.setBindGroup(1, device.createBindGroup({ layout: pipeline.getBindGroupLayout(1), entries: [{ binding: 0, resource: storage(packed) }] }));
  pass.draw(3);
  pass.end();
  encoder.copyTextureToBuffer({ texture: target }, { buffer: read, bytesPerRow }, [points, 1]);
  device.queue.submit([encoder.finish()]);
  const problem = await device.popErrorScope();
  if (problem) throw new Error(problem.message);
  await read.mapAsync(GPUMapMode.READ);
  const values = new Float32Array(read.getMappedRange());
  const rows = Array.from({ length: points }, (_, p) => [...values.slice(4 * p, 4 * p + 3)]);
  device.destroy();
  return rows;
}

/** Whether a Shadertoy text compiles, and the colour of its middle and corner pixels. */
export function runShadertoy(text: string): number[][] {
  const gl = new OffscreenCanvas(32, 32).getContext("webgl2")!;
  const head = "#version 300 es\nprecision highp float;\nprecision highp int;\nuniform vec3 iResolution;\nuniform vec4 iMouse;\nuniform float iTime;\nout vec4 shown;\n";
  const program = gl.createProgram();
  for (const [type, source] of [
    [gl.VERTEX_SHADER, "#version 300 es\nvoid main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }"],
    [gl.FRAGMENT_SHADER, `${head}${text}\nvoid main() { mainImage(shown, gl_FragCoord.xy); }`],
  ] as const) {
    const shader = gl.createShader(type)!;
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? "compile");
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "link");
  gl.useProgram(program);
  gl.uniform3f(gl.getUniformLocation(program, "iResolution"), 32, 32, 1);
  gl.uniform4f(gl.getUniformLocation(program, "iMouse"), 16, 16, 1, 1);
  gl.viewport(0, 0, 32, 32);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const pixels = new Uint8Array(4 * 32 * 32);
  gl.readPixels(0, 0, 32, 32, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  return [0, 16 * 33, 32 * 32 - 1].map((i) => [...pixels.slice(4 * i, 4 * i + 4)]);
}
