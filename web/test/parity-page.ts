/** Functions that run inside the browser page; each is self-contained, because Playwright sends their text. */

/** A printed graph with everything that a page needs to run it at N points. */
export interface Job {
  readonly name: string;
  /** Whole shader. */
  readonly code: string;
  readonly points: number;
  /** vec4 blocks of the inputs: [blocks][points][4]. */
  readonly inputs: number[];
  readonly inputBlocks: number;
  readonly outputBlocks: number;
  /** Weights: textures for WebGL2 (base64 of half floats or floats), one storage buffer for WebGPU. */
  readonly textures: { name: string; width: number; height: number; half: boolean; data: string }[];
  readonly weights: number[] | null;
  /** Per-frame values as blocks. */
  readonly frame: { name: string; texture: boolean; data: number[] } | null;
}

/** Runs jobs in WebGL2, one fragment per point and output block; returns [blocks][points][4] each. */
export function runWebgl2(jobs: Job[]): { name: string; values: number[]; error: string }[] {
  const canvas = document.createElement("canvas");
  const gl = canvas.getContext("webgl2");
  if (!gl?.getExtension("EXT_color_buffer_float")) throw new Error("no WebGL2 with EXT_color_buffer_float");
  const compile = (type: number, text: string) => {
    const shader = gl.createShader(type)!;
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
      throw new Error(gl.getShaderInfoLog(shader) ?? "compile");
    return shader;
  };
  const decode = (text: string, half: boolean) => {
    const letters = atob(text);
    const bytes = new Uint8Array(letters.length);
    // Millions of weights: ten times as fast as Uint8Array.from.
    for (let at = 0; at < bytes.length; at++) bytes[at] = letters.charCodeAt(at);
    return half ? new Uint16Array(bytes.buffer) : new Float32Array(bytes.buffer);
  };
  const texture = (width: number, height: number, half: boolean, pixels: ArrayBufferView | null) => {
    const object = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, object);
    const format = half ? gl.RGBA16F : gl.RGBA32F;
    gl.texImage2D(
      gl.TEXTURE_2D,
      0,
      format,
      width,
      height,
      0,
      gl.RGBA,
      half ? gl.HALF_FLOAT : gl.FLOAT,
      pixels,
    );
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return object;
  };
  const vertex = compile(
    gl.VERTEX_SHADER,
    "#version 300 es\nvoid main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }",
  );
  const run = (job: Job) => {
    const program = gl.createProgram();
    const fragment = compile(gl.FRAGMENT_SHADER, job.code);
    gl.attachShader(program, vertex);
    gl.attachShader(program, fragment);
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS))
      throw new Error(gl.getProgramInfoLog(program) ?? "link");
    gl.useProgram(program);
    const sources = [
      {
        name: "inputs",
        width: job.points,
        height: job.inputBlocks,
        half: false,
        data: Float32Array.from(job.inputs) as ArrayBufferView,
      },
      ...job.textures.map((source) => ({ ...source, data: decode(source.data, source.half) })),
    ];
    if (job.frame?.texture) {
      const width = job.frame.data.length / 4;
      const data = Float32Array.from(job.frame.data);
      sources.push({ name: job.frame.name, width, height: 1, half: false, data });
    } else if (job.frame) {
      gl.uniform4fv(gl.getUniformLocation(program, job.frame.name), Float32Array.from(job.frame.data));
    }
    const objects = sources.map((source, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      const object = texture(source.width, source.height, source.half, source.data);
      gl.uniform1i(gl.getUniformLocation(program, source.name), unit);
      return object;
    });
    gl.activeTexture(gl.TEXTURE0 + sources.length);
    const target = texture(job.points, job.outputBlocks, false, null);
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.viewport(0, 0, job.points, job.outputBlocks);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const values = new Float32Array(4 * job.points * job.outputBlocks);
    gl.readPixels(0, 0, job.points, job.outputBlocks, gl.RGBA, gl.FLOAT, values);
    const code = gl.getError();
    for (const object of [...objects, target]) gl.deleteTexture(object);
    gl.deleteFramebuffer(framebuffer);
    gl.deleteProgram(program);
    gl.deleteShader(fragment);
    if (code || gl.isContextLost()) throw new Error(`GL error ${code}, context lost: ${gl.isContextLost()}`);
    return [...values];
  };
  return jobs.map((job) => {
    try {
      return { name: job.name, values: run(job), error: "" };
    } catch (error) {
      return { name: job.name, values: [], error: String(error) };
    }
  });
}

/** Runs jobs in WebGPU compute, one invocation per point; returns [blocks][points][4] each, or null without an adapter. */
export async function runWebgpu(
  jobs: Job[],
): Promise<{ name: string; values: number[]; error: string }[] | null> {
  const adapter = await navigator.gpu?.requestAdapter();
  if (!adapter) return null;
  const device = await adapter.requestDevice();
  const buffer = (numbers: number[], usage: number) => {
    const object = device.createBuffer({ size: 4 * numbers.length, usage: usage | GPUBufferUsage.COPY_DST });
    device.queue.writeBuffer(object, 0, Float32Array.from(numbers));
    return object;
  };
  const run = async (job: Job) => {
    device.pushErrorScope("validation");
    const module = device.createShaderModule({ code: job.code });
    const { messages } = await module.getCompilationInfo();
    const text = messages.map((m) => `${m.lineNum}: ${m.message}`).join("\n");
    if (messages.some((m) => m.type === "error")) throw new Error(text);
    const pipeline = await device.createComputePipelineAsync({
      layout: "auto",
      compute: { module, entryPoint: "main" },
    });
    const size = 16 * job.points * job.outputBlocks;
    const out = device.createBuffer({ size, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC });
    const read = device.createBuffer({ size, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    const inputs = buffer(job.inputs, GPUBufferUsage.STORAGE);
    const weights = job.weights && buffer(job.weights, GPUBufferUsage.STORAGE);
    const frame = job.frame && buffer(job.frame.data, GPUBufferUsage.UNIFORM);
    const encoder = device.createCommandEncoder();
    const pass = encoder.beginComputePass();
    pass.setPipeline(pipeline);
    const entries = [
      { binding: 0, resource: { buffer: inputs } },
      { binding: 1, resource: { buffer: out } },
    ];
    pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries }));
    const own = [
      ...(weights ? [{ binding: 0, resource: { buffer: weights } }] : []),
      ...(frame ? [{ binding: 1, resource: { buffer: frame } }] : []),
    ];
    if (own.length) {
      pass.setBindGroup(1, device.createBindGroup({ layout: pipeline.getBindGroupLayout(1), entries: own }));
    }
    pass.dispatchWorkgroups(job.points);
    pass.end();
    encoder.copyBufferToBuffer(out, 0, read, 0, size);
    device.queue.submit([encoder.finish()]);
    const problem = await device.popErrorScope();
    if (problem) throw new Error(problem.message);
    await read.mapAsync(GPUMapMode.READ);
    const values = [...new Float32Array(read.getMappedRange())];
    for (const object of [out, read, inputs, weights, frame]) object?.destroy();
    return values;
  };
  const results = [];
  for (const job of jobs) {
    try {
      results.push({ name: job.name, values: await run(job), error: "" });
    } catch (error) {
      results.push({ name: job.name, values: [], error: String(error) });
    }
  }
  return results;
}
