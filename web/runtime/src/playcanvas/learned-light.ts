/** The learned light of a file that PlayCanvas has loaded. */

import {
  ADDRESS_CLAMP_TO_EDGE,
  type AppBase,
  type Asset,
  BoundingBox,
  type ContainerResource,
  Entity,
  FILTER_NEAREST,
  Layer,
  Mat4,
  type MeshInstance,
  PIXELFORMAT_RGBA16F,
  PIXELFORMAT_RGBA32F,
  type RenderComponent,
  SHADERLANGUAGE_GLSL,
  ShaderChunks,
  StandardMaterial,
  Texture,
  Vec3,
} from "playcanvas";
import { FormatError, type Vec3 as Triple } from "../checks.ts";
import { coreDiagonal } from "../core-record.ts";
import { isClear } from "../clear-glass.ts";
import type { EngineLamp } from "../engines/engine-lamp.ts";
import { EngineLight, type EngineParts } from "../engines/engine-light.ts";
import { pointShadow, SHADOW_TAPS } from "../engines/point-shadow.ts";
import type { NeuralRadiance } from "../extension.ts";
import type { TexelTexture } from "../graph/glsl.ts";
import { chunksOf } from "./chunks.ts";
import { CUBE_SIZE, DistanceCube, distanceFormat, type Reach } from "./distance-cube.ts";

/** Version of PlayCanvas's shader chunks that ours are written for. */
const CHUNKS_VERSION = "2.7";
/** Nearest occluder as a share of the diagonal of what is looked at. */
const NEAR_SHARE = 5e-4;
/** The lamp has been moved by hand when it is farther than this from where it was put. */
const MOVED = 1e-5;

/** A declared light: `entity` hangs on the root and may be moved as any other. */
export interface PlayCanvasLamp {
  readonly entity: Entity;
  readonly lamp: EngineLamp;
  /** Move the lamp, in the space of the file; returns whether the wish had to be clamped to what was learned. */
  move(wish: Triple): boolean;
}

interface Shadowed extends PlayCanvasLamp {
  /** Null for a sun, which casts no shadow here, and where the device cannot draw distances. */
  readonly cube: DistanceCube | null;
  drawn: string;
}

/** Options of the learned light. */
export interface LearnedLightOptions {
  /** Where weights live; by default small fields are literals and large ones textures. */
  readonly weights?: "inline" | "texture";
}

/** Lights the meshes of one file; it follows lamps and root by itself before every frame. */
export class LearnedLight {
  /** Holds the file; put it anywhere, scaled alike along all axes. */
  readonly root = new Entity("lightwell");
  readonly lamps: readonly PlayCanvasLamp[];
  private readonly app: AppBase;
  private readonly asset: Asset;
  private readonly light: EngineLight;
  private readonly layer = new Layer({ name: "lightwell distances" });
  private readonly shadowed: readonly Shadowed[];
  private readonly textures: readonly Texture[];
  private readonly materials: StandardMaterial[] = [];
  private readonly toFile = new Mat4();

  constructor(app: AppBase, asset: Asset, radiance: NeuralRadiance, { weights }: LearnedLightOptions) {
    this.app = app;
    this.asset = asset;
    this.light = new EngineLight(radiance, weights);
    if (this.light.fields.some((field) => field.readsUv))
      throw new FormatError("lightwell/playcanvas: expected a field of places and directions, found one that reads texture coordinates; show it with three.js or Babylon.js");
    this.root.addChild((asset.resource as ContainerResource).instantiateRenderEntity());
    const instances = (this.root.findComponents("render") as RenderComponent[]).flatMap((render) => render.meshInstances);
    const diagonal = diagonalOf(instances);
    const reach = { near: NEAR_SHARE * Math.min(diagonal, radiance.core ? coreDiagonal(radiance.core) : diagonal), far: 1.01 * diagonal };
    app.scene.layers.push(this.layer);
    this.layer.addMeshInstances(instances);
    this.shadowed = this.light.lamps.map((lamp) => this.createLamp(lamp, reach));
    this.lamps = this.shadowed;
    this.textures = this.light.textures.map((table) => tableTexture(app, table));
    this.patch(new Set(instances.map(({ material }) => material as StandardMaterial)), radiance.glass);
    app.on("update", this.update, this);
    // Frames may end that were not drawn.
    app.on("postrender", this.rest, this);
    app.graphicsDevice.on("devicerestored", this.renewShadows, this);
  }

  /** Choose which parts of the light are shown. */
  show(parts: EngineParts): void {
    this.light.show(parts);
  }

  /** Follow lamps and root; done by itself before every frame. */
  update(): void {
    const toWorld = this.root.getWorldTransform();
    this.toFile.copy(toWorld).invert();
    for (const lamp of this.shadowed) this.follow(lamp, toWorld);
    this.light.update();
    for (const material of this.materials) this.bind(material);
  }

  /** Free what was made for the light, and the file itself. */
  dispose(): void {
    this.app.off("update", this.update, this);
    this.app.off("postrender", this.rest, this);
    this.app.graphicsDevice.off("devicerestored", this.renewShadows, this);
    this.app.scene.layers.remove(this.layer);
    for (const { cube } of this.shadowed) cube?.dispose();
    for (const texture of this.textures) texture.destroy();
    this.root.destroy();
    this.app.assets.remove(this.asset);
    this.asset.unload();
  }

  private rest(): void {
    for (const { cube } of this.shadowed) cube?.rest();
  }

  /** A restored context has lost the distances. */
  private renewShadows(): void {
    for (const shadowed of this.shadowed) shadowed.drawn = "";
  }

  private createLamp(lamp: EngineLamp, reach: Reach): Shadowed {
    const entity = new Entity(lamp.variable.name);
    this.root.addChild(entity);
    const put = () => entity.setLocalPosition(...lamp.value);
    put();
    const format = distanceFormat(this.app.graphicsDevice);
    const cube = lamp.variable.kind === "point" && format ? new DistanceCube(this.app, this.layer, reach, format) : null;
    const move = (wish: Triple) => {
      const clamped = lamp.move(wish);
      put();
      return clamped;
    };
    return { entity, lamp, cube, move, drawn: "" };
  }

  /** Take up what was done to a lamp's entity, and draw its distances anew when anything has moved. */
  private follow(shadowed: Shadowed, toWorld: Mat4): void {
    const { entity, lamp, cube } = shadowed;
    const { x, y, z } = this.toFile.transformPoint(entity.getPosition(), new Vec3());
    if (lamp.variable.kind === "point" && Math.hypot(x - lamp.value[0], y - lamp.value[1], z - lamp.value[2]) > MOVED) shadowed.move([x, y, z]);
    const key = [...lamp.value, ...toWorld.data].join();
    if (key === shadowed.drawn) return;
    shadowed.drawn = key;
    cube?.draw(entity.getPosition());
  }

  /** Give materials the text of the light. */
  private patch(materials: ReadonlySet<StandardMaterial>, glass?: boolean): void {
    const shadows = this.shadowed.map(({ cube }, i) =>
      cube ? `uniform samplerCube lightwellCube${i};\nuniform vec3 lightwellEye${i};\n${pointShadow(i, `lightwellEye${i}`, `${CUBE_SIZE}.0`, `textureLod( lightwellCube${i}, direction, 0.0 ).x`)}` : "",
    );
    const lit = new Set([...this.shadowed.keys()].filter((i) => this.shadowed[i]!.cube));
    const code = this.light.code(`${SHADOW_TAPS}\n${shadows.join("\n")}`, lit);
    const combine = ShaderChunks.get(this.app.graphicsDevice, SHADERLANGUAGE_GLSL).get("combinePS") as string;
    for (const material of materials) {
      if (!(material instanceof StandardMaterial) || (!glass && isClear(material.refraction, 1 - material.gloss))) continue;
      material.shaderChunksVersion = CHUNKS_VERSION;
      const chunks = material.getShaderChunks(SHADERLANGUAGE_GLSL);
      for (const [name, text] of Object.entries(chunksOf(code, combine))) chunks.set(name, text);
      // Learned light has that of the bake's environment already.
      material.useSkybox = false;
      for (const texture of this.textures) material.setParameter(texture.name, texture);
      this.bind(material);
      material.update();
      this.materials.push(material);
    }
  }

  private bind(material: StandardMaterial): void {
    material.setParameter("lightwellToFile", this.toFile.data as Float32Array);
    for (const { name, values, isArray } of this.light.uniforms) material.setParameter(isArray ? `${name}[0]` : name, values);
    this.shadowed.forEach(({ cube, entity }, i) => {
      if (!cube) return;
      const { x, y, z } = entity.getPosition();
      material.setParameter(`lightwellEye${i}`, [x, y, z]);
      material.setParameter(`lightwellCube${i}`, cube.texture);
    });
  }
}

/** Diagonal of the bounds of meshes, metres of the world. */
function diagonalOf(instances: readonly MeshInstance[]): number {
  const bounds = new BoundingBox();
  instances.forEach(({ aabb }, i) => void (i === 0 ? bounds.copy(aabb) : bounds.add(aabb)));
  return 2 * bounds.halfExtents.length() || 1;
}

function tableTexture(app: AppBase, { name, data, width, height, format }: TexelTexture): Texture {
  return new Texture(app.graphicsDevice, {
    ...{ name, width, height, mipmaps: false, minFilter: FILTER_NEAREST, magFilter: FILTER_NEAREST },
    ...{ addressU: ADDRESS_CLAMP_TO_EDGE, addressV: ADDRESS_CLAMP_TO_EDGE },
    format: format === "rgba16float" ? PIXELFORMAT_RGBA16F : PIXELFORMAT_RGBA32F,
    // Its types know bytes alone.
    levels: [data as unknown as Uint8Array],
  });
}
