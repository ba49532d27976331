/** The shading graph in the web runtime: reads, evaluates on the CPU, prints GLSL and WGSL. */

export { BUDGET, type Budget, budgetOf, overBudget } from "./budget.ts";
export { valuesOf } from "./buffers.ts";
export { evaluate, evaluateNodes } from "./evaluate.ts";
export { evaluateFrame, type FrameLayout, frameLayout } from "./frame.ts";
export {
  FRAME_UNIFORM_LIMIT,
  type FrameUniform,
  type GlslOptions,
  type GlslProgram,
  printGlsl,
  type TexelTexture,
} from "./glsl.ts";
export { FRAME_INPUTS } from "./graph.ts";
export { fromHalf, toHalf } from "./half.ts";
export type { Graph, GraphNode } from "./node.ts";
export type { BufferType, StoredBuffer } from "./op.ts";
export { OPS } from "./ops/index.ts";
export { only } from "./part.ts";
export { readGraph } from "./read.ts";
export { printWgsl, type WgslOptions, type WgslProgram } from "./wgsl.ts";
