/** What users of three.js do to a scene with learned light, and the pictures that come of it. */

import { LearnedScene, type LearnedSceneOptions, LightwellLoaderPlugin } from "lightwell";
import {
  type Camera,
  Color,
  DataTexture,
  EquirectangularReflectionMapping,
  FloatType,
  Group,
  Mesh,
  MeshStandardMaterial,
  type Object3D,
  OrthographicCamera,
  PerspectiveCamera,
  PointLight,
  Quaternion,
  RGBAFormat,
  Scene,
  Vector3,
  WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const [WIDTH, HEIGHT] = [64, 48];
/** Red, green and blue of every pixel, linear. */
type Picture = number[];

function makeRenderer(): WebGLRenderer {
  const renderer = new WebGLRenderer({ canvas: document.createElement("canvas") });
  renderer.setSize(WIDTH, HEIGHT, false);
  renderer.shadowMap.enabled = true;
  return renderer;
}

function makeCamera(): PerspectiveCamera {
  const camera = new PerspectiveCamera(36, WIDTH / HEIGHT, 0.01, 100);
  camera.position.set(0, 1, 4.2);
  camera.lookAt(0, 1, 0);
  return camera;
}

const glb = () => Uint8Array.from(atob(document.body.dataset.glb!), (c) => c.charCodeAt(0)).buffer;
const load = () => new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)).parseAsync(glb(), "");

/** Draw a scene and read it back. */
function draw(renderer: WebGLRenderer, scene: Scene, camera: Camera = makeCamera()): Picture {
  const target = new WebGLRenderTarget(WIDTH, HEIGHT, { type: FloatType });
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  const rows = new Float32Array(4 * WIDTH * HEIGHT);
  renderer.readRenderTargetPixels(target, 0, 0, WIDTH, HEIGHT, rows);
  renderer.setRenderTarget(null);
  target.dispose();
  return Array.from(rows).filter((_, i) => i % 4 < 3);
}

async function put(renderer: WebGLRenderer, options: LearnedSceneOptions = {}) {
  const gltf = await load();
  const learned = new LearnedScene(gltf, { renderer, ...options });
  const scene = new Scene();
  scene.add(learned.root);
  return { gltf, learned, scene };
}

const materialsOf = (root: Object3D) => {
  const found = new Set<MeshStandardMaterial>();
  root.traverse((object) => {
    if (object instanceof Mesh) for (const material of [object.material].flat()) found.add(material);
  });
  return [...found];
};

/** Adds a quarter to the red of everything: what a user's own hook does. */
const redder: MeshStandardMaterial["onBeforeCompile"] = (shader) => {
  shader.fragmentShader = shader.fragmentShader.replace("#include <dithering_fragment>", "#include <dithering_fragment>\ngl_FragColor.r += 0.25;");
};

/** White light from everywhere. */
function whiteSky(): DataTexture {
  const texture = new DataTexture(new Float32Array(4 * 64 * 32).fill(1), 64, 32, RGBAFormat, FloatType);
  texture.mapping = EquirectangularReflectionMapping;
  texture.needsUpdate = true;
  return texture;
}

/** Each with a renderer of its own, which `run` disposes of. */
const SCENARIOS = {
  /** As it is loaded, somewhere else in another orientation and size, and there within groups of their own. */
  async placed(renderer: WebGLRenderer): Promise<Picture[]> {
    const { learned, scene } = await put(renderer);
    learned.update();
    const pictures = [draw(renderer, scene)];
    const place = { at: new Vector3(5, -2, 3), turn: new Quaternion(0.2, 0.5, -0.1, 0.8).normalize(), scale: 0.25 };
    const parent = new Group();
    parent.position.copy(place.at);
    parent.quaternion.copy(place.turn);
    parent.scale.setScalar(place.scale);
    scene.add(parent.add(learned.root));
    const camera = makeCamera();
    camera.position.multiplyScalar(place.scale).applyQuaternion(place.turn).add(place.at);
    camera.quaternion.premultiply(place.turn);
    learned.update();
    pictures.push(draw(renderer, scene, camera));
    return pictures;
  },

  async uneven(renderer: WebGLRenderer): Promise<string> {
    const { learned } = await put(renderer);
    learned.root.scale.set(1, 2, 1);
    try {
      learned.update();
      return "";
    } catch (error) {
      return (error as Error).message;
    }
  },

  /** `move`, the light's own position, and a light that hangs elsewhere; colour and intensity both ways. */
  async lamp(renderer: WebGLRenderer): Promise<{ pictures: Picture[]; clamped: number[] }> {
    const { learned, scene } = await put(renderer);
    const [lamp] = learned.lamps;
    const light = lamp!.object as PointLight;
    const home = lamp!.value.clone();
    const place = new Vector3(0.4, 0.8, 0.3);
    const pictures: Picture[] = [];
    const take = () => {
      learned.update();
      pictures.push(draw(renderer, scene));
    };
    lamp!.move(place);
    lamp!.intensity *= 2;
    lamp!.color.set(1, 0.5, 0.25);
    take();
    lamp!.move(home);
    take();
    light.position.copy(place);
    take();
    light.position.copy(home);
    const arm = new Group();
    arm.position.set(0.1, 0.2, 0);
    arm.rotation.set(0.3, 0.2, 0.1);
    scene.add(arm.add(light));
    light.position.copy(arm.worldToLocal(place.clone()));
    arm.updateMatrixWorld();
    light.position.copy(arm.worldToLocal(place.clone()));
    take();
    light.position.copy(arm.worldToLocal(new Vector3(0, 50, 0)));
    learned.update();
    const clamped = lamp!.value.toArray();
    learned.root.add(light);
    light.position.copy(home);
    light.intensity /= 2;
    light.color.set(1, 0.9, 0.8);
    take();
    return { pictures, clamped };
  },

  /** Plain, with the user's hook from before, from after, and with none again. */
  async hooks(renderer: WebGLRenderer): Promise<Picture[]> {
    const gltf = await load();
    const before = materialsOf(gltf.scene);
    for (const material of before) material.onBeforeCompile = redder;
    const learned = new LearnedScene(gltf, { renderer });
    const scene = new Scene();
    scene.add(learned.root);
    const set = (hook: MeshStandardMaterial["onBeforeCompile"]) => {
      for (const material of materialsOf(learned.root)) {
        material.onBeforeCompile = hook;
        material.needsUpdate = true;
      }
    };
    learned.update();
    const pictures = [draw(renderer, scene)];
    set(() => {});
    pictures.push(draw(renderer, scene));
    set(redder);
    pictures.push(draw(renderer, scene));
    learned.dispose();
    pictures.push(draw(renderer, scene));
    return pictures;
  },

  /** Edits of the file's materials, in every look. */
  async edits(renderer: WebGLRenderer): Promise<Record<string, number[]>> {
    const { learned, scene } = await put(renderer);
    const camera = makeCamera();
    const target = new WebGLRenderTarget(WIDTH, HEIGHT, { type: FloatType });
    const look = async (half: boolean) => {
      learned.update();
      await learned.compile(renderer, scene, camera, { half, segments: false });
      renderer.setRenderTarget(target);
      learned.render(renderer, scene, camera, WIDTH, HEIGHT);
      const rows = new Float32Array(4 * WIDTH * HEIGHT);
      renderer.readRenderTargetPixels(target, 0, 0, WIDTH, HEIGHT, rows);
      renderer.setRenderTarget(null);
      const at = 4 * (WIDTH * (HEIGHT / 2) + WIDTH / 2);
      return Array.from(rows.subarray(at, at + 3));
    };
    const found: Record<string, number[]> = { full: await look(false), half: await look(true) };
    for (const material of materialsOf(learned.root)) material.emissive.set(0.5, 0, 0);
    Object.assign(found, { fullLit: await look(false), halfLit: await look(true) });
    const green = new MeshStandardMaterial({ color: 0, emissive: new Color(0, 1, 0) });
    learned.root.traverse((object) => {
      if (object instanceof Mesh) object.material = green;
    });
    Object.assign(found, { fullOther: await look(false), halfOther: await look(true) });
    target.dispose();
    return found;
  },

  /** Before, with learned light, after `dispose`, and what is left of it. */
  async restored(renderer: WebGLRenderer): Promise<{ pictures: Picture[]; left: unknown; first: unknown }> {
    const gltf = await load();
    gltf.scene.add(new PointLight(0xffffff, 3));
    gltf.scene.children.at(-1)!.position.set(0, 1, 0);
    const state = () => {
      const materials = materialsOf(gltf.scene);
      const nodes: string[] = [];
      gltf.scene.traverse((object) => void nodes.push(`${object.type} ${object.castShadow} ${object.receiveShadow}`));
      return { nodes, sides: materials.map(({ shadowSide }) => shadowSide), own: materials.map((material) => Object.hasOwn(material, "onBeforeCompile") || Object.hasOwn(material, "customProgramCacheKey")) };
    };
    const scene = new Scene();
    scene.add(gltf.scene);
    const first = state();
    const pictures = [draw(renderer, scene)];
    const learned = new LearnedScene(gltf, { renderer });
    learned.update();
    pictures.push(draw(renderer, scene));
    learned.dispose();
    pictures.push(draw(renderer, scene));
    const left = state();
    learned.attach();
    learned.update();
    pictures.push(draw(renderer, scene));
    return { pictures, left, first };
  },

  /** With the lamp's shadow, without it, and with it again. */
  async shadows(renderer: WebGLRenderer): Promise<Picture[]> {
    const { learned, scene } = await put(renderer);
    const light = learned.lamps[0]!.object as PointLight;
    return [true, false, true].map((on) => {
      light.castShadow = on;
      learned.update();
      return draw(renderer, scene);
    });
  },

  /** How often a texture of the model is freed: by a scene that leaves textures, and by one that does not. */
  async textures(renderer: WebGLRenderer): Promise<number[]> {
    const { gltf, learned } = await put(renderer);
    let freed = 0;
    const map = new DataTexture(new Uint8Array([255, 255, 255, 255]), 1, 1);
    map.addEventListener("dispose", () => void freed++);
    materialsOf(gltf.scene)[0]!.map = map;
    learned.dispose({ textures: false });
    const kept = freed;
    learned.attach();
    learned.dispose();
    return [kept, freed];
  },

  /** One scene after the other on one root, the first of them forgotten; then two roots in one picture and alone. */
  async twice(renderer: WebGLRenderer): Promise<{ pictures: Picture[]; lights: number }> {
    const { gltf, learned, scene } = await put(renderer);
    learned.update();
    const pictures = [draw(renderer, scene)];
    const second = new LearnedScene(gltf, { renderer });
    learned.update();
    second.update();
    pictures.push(draw(renderer, scene));
    let lights = 0;
    scene.traverse((object) => void (lights += object instanceof PointLight ? 1 : 0));
    learned.dispose();
    pictures.push(draw(renderer, scene));
    const other = await put(renderer);
    other.learned.lamps[0]!.intensity = 1;
    other.learned.update();
    pictures.push(draw(renderer, other.scene));
    pictures.push(draw(renderer, scene));
    return { pictures, lights };
  },

  /** A second renderer, then a lost and restored context. */
  async renderers(renderer: WebGLRenderer): Promise<Picture[]> {
    const { learned, scene } = await put(renderer);
    const other = makeRenderer();
    const pictures: Picture[] = [];
    for (const one of [renderer, other, renderer, other]) {
      learned.update(one);
      pictures.push(draw(one, scene));
    }
    learned.lamps[0]!.move(new Vector3(0.4, 0.8, 0.3));
    for (const one of [renderer, other]) {
      learned.update(one);
      pictures.push(draw(one, scene));
    }
    other.dispose();
    other.forceContextLoss();
    const restored = new Promise((resolve) => renderer.domElement.addEventListener("webglcontextrestored", resolve, { once: true }));
    renderer.forceContextLoss();
    await new Promise((resolve) => setTimeout(resolve, 50));
    renderer.forceContextRestore();
    await restored;
    learned.update();
    pictures.push(draw(renderer, scene));
    return pictures;
  },

  async environments(renderer: WebGLRenderer): Promise<Picture[]> {
    const pictures: Picture[] = [];
    const sky = whiteSky();
    for (const [policy, lit] of [["remove", false], ["remove", true], ["keep", true]] as const) {
      const { learned, scene } = await put(renderer, { environment: policy });
      if (lit) scene.environment = sky;
      learned.update();
      pictures.push(draw(renderer, scene));
      learned.dispose();
    }
    return pictures;
  },

  /** A parallel view: every ray has the direction of the camera. */
  async parallel(renderer: WebGLRenderer): Promise<Picture> {
    const { learned, scene } = await put(renderer);
    learned.lamps[0]!.intensity = 0;
    learned.update();
    const camera = new OrthographicCamera(-1, 1, 0.75, -0.75, 0.1, 20);
    camera.position.set(0, 1, 5);
    return draw(renderer, scene, camera);
  },

  async cycles(renderer: WebGLRenderer): Promise<{ geometries: number; textures: number; programs: number }[]> {
    const seen = [];
    for (let i = 0; i < Number(document.body.dataset.cycles ?? 6); i++) {
      const { learned, scene } = await put(renderer);
      learned.update();
      draw(renderer, scene);
      learned.dispose();
      const { memory, programs } = renderer.info;
      seen.push({ geometries: memory.geometries, textures: memory.textures, programs: programs!.length });
    }
    return seen;
  },

  /** A user's hook that takes away what the finish needs. */
  async broken(renderer: WebGLRenderer): Promise<string> {
    const { learned, scene } = await put(renderer);
    for (const material of materialsOf(learned.root))
      material.onBeforeCompile = (shader) => {
        shader.fragmentShader = shader.fragmentShader.replace("#include <opaque_fragment>", "");
      };
    learned.update();
    try {
      draw(renderer, scene);
      return "";
    } catch (error) {
      return (error as Error).message;
    }
  },
} as const;

export type Scenarios = typeof SCENARIOS;
export type Result<K extends keyof Scenarios> = Awaited<ReturnType<Scenarios[K]>>;

declare global {
  interface Window {
    /** Runs one of a page's scenarios with a renderer of its own. */
    scenario(name: string): Promise<unknown>;
  }
}

window.scenario = async (name) => {
  const renderer = makeRenderer();
  const result = await SCENARIOS[name as keyof Scenarios](renderer);
  renderer.dispose();
  renderer.forceContextLoss();
  return result;
};
