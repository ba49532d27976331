/** Features of three.js beside learned light: other kinds of meshes, cameras and renderers, and the light of others. */

import { LearnedScene, LightwellLoaderPlugin, loadLight } from "lightwell";
import {
  ArrayCamera,
  BufferAttribute,
  Bone,
  type BufferGeometry,
  type Camera,
  FloatType,
  Fog,
  InstancedMesh,
  Matrix4,
  Mesh,
  PerspectiveCamera,
  Plane,
  PointLight,
  Scene,
  Skeleton,
  SkinnedMesh,
  Vector3,
  Vector4,
  WebGLRenderer,
  type WebGLRendererParameters,
  WebGLRenderTarget,
} from "three";
import { type GLTF, GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const [WIDTH, HEIGHT] = [64, 48];
type Picture = number[];

function makeRenderer(parameters: WebGLRendererParameters = {}): WebGLRenderer {
  const renderer = new WebGLRenderer({ canvas: document.createElement("canvas"), ...parameters });
  renderer.setSize(WIDTH, HEIGHT, false);
  renderer.shadowMap.enabled = true;
  return renderer;
}

function makeCamera(x = 0): PerspectiveCamera {
  const camera = new PerspectiveCamera(36, WIDTH / HEIGHT, 0.1, 20);
  camera.position.set(x, 1, 4.2);
  camera.lookAt(0, 1, 0);
  camera.updateMatrixWorld();
  return camera;
}

const glb = () => Uint8Array.from(atob(document.body.dataset.glb!), (c) => c.charCodeAt(0)).buffer;
const load = () => new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)).parseAsync(glb(), "");

/** Red, green and blue of every pixel, linear. */
function draw(renderer: WebGLRenderer, scene: Scene, camera: Camera = makeCamera(), width = WIDTH): Picture {
  const target = new WebGLRenderTarget(width, HEIGHT, { type: FloatType });
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  const rows = new Float32Array(4 * width * HEIGHT);
  renderer.readRenderTargetPixels(target, 0, 0, width, HEIGHT, rows);
  renderer.setRenderTarget(null);
  target.dispose();
  return Array.from(rows).filter((_, i) => i % 4 < 3);
}

/** Light a file and draw it. */
function show(renderer: WebGLRenderer, gltf: GLTF, prepare: (scene: Scene) => void = () => {}): Picture {
  const learned = new LearnedScene(gltf, { renderer });
  const scene = new Scene();
  scene.add(learned.root);
  prepare(scene);
  learned.update();
  return draw(renderer, scene);
}

/** How far the ball is moved, by each feature in its own way. */
const STEP = new Vector3(-0.15, 0.1, 0.05);

/** The file with something in the place of its ball, which is the mesh with the most vertices. */
async function replaced(make: (ball: Mesh<BufferGeometry>) => Mesh): Promise<GLTF> {
  const gltf = await load();
  const meshes: Mesh[] = [];
  gltf.scene.traverse((object) => void (object instanceof Mesh && meshes.push(object)));
  const ball = meshes.reduce((a, b) => (a.geometry.attributes.position!.count > b.geometry.attributes.position!.count ? a : b));
  const other = make(ball);
  if (other !== ball) {
    ball.parent!.add(other);
    ball.removeFromParent();
  }
  return gltf;
}

function moved(ball: Mesh): Mesh {
  ball.position.add(STEP);
  return ball;
}

function instanced(ball: Mesh<BufferGeometry>): Mesh {
  const mesh = new InstancedMesh(ball.geometry, ball.material, 1);
  mesh.setMatrixAt(0, new Matrix4().makeTranslation(STEP));
  return mesh;
}

function skinned(ball: Mesh<BufferGeometry>): Mesh {
  const { count } = ball.geometry.attributes.position!;
  ball.geometry.setAttribute("skinIndex", new BufferAttribute(new Uint16Array(4 * count), 4));
  ball.geometry.setAttribute("skinWeight", new BufferAttribute(Float32Array.from({ length: 4 * count }, (_, i) => (i % 4 === 0 ? 1 : 0)), 4));
  const mesh = new SkinnedMesh(ball.geometry, ball.material);
  const bone = new Bone();
  mesh.add(bone);
  mesh.bind(new Skeleton([bone]));
  bone.position.copy(STEP);
  mesh.frustumCulled = false;
  return mesh;
}

function morphed(ball: Mesh<BufferGeometry>): Mesh {
  const { count } = ball.geometry.attributes.position!;
  const step = Float32Array.from({ length: 3 * count }, (_, i) => STEP.getComponent(i % 3));
  ball.geometry.morphAttributes.position = [new BufferAttribute(step, 3)];
  ball.geometry.morphTargetsRelative = true;
  const mesh = new Mesh(ball.geometry, ball.material);
  mesh.updateMorphTargets();
  mesh.morphTargetInfluences![0] = 1;
  return mesh;
}

const SCENARIOS = {
  /** The ball moved as a mesh, an instance, by a bone and by a morph target; and not at all. */
  async meshes(renderer: WebGLRenderer): Promise<Picture[]> {
    const pictures: Picture[] = [];
    for (const make of [moved, instanced, skinned, morphed, (ball: Mesh) => ball]) pictures.push(show(renderer, await replaced(make)));
    return pictures;
  },

  /** Everything left of the middle is cut away. */
  async clipping(renderer: WebGLRenderer): Promise<Picture[]> {
    const whole = show(renderer, await load());
    renderer.clippingPlanes = [new Plane(new Vector3(1, 0, 0), 0)];
    return [whole, show(renderer, await load())];
  },

  /** With a logarithmic depth buffer, and without what half-float targets need. */
  async depthAndHalves(renderer: WebGLRenderer): Promise<Picture[]> {
    const plain = show(renderer, await load());
    const logarithmic = makeRenderer({ logarithmicDepthBuffer: true });
    const pictures = [plain, show(logarithmic, await load())];
    logarithmic.dispose();
    return pictures;
  },

  /** The canvas of a device that draws into no floats; bytes. */
  async withoutHalfFloats(): Promise<number[][]> {
    const own = WebGL2RenderingContext.prototype.getExtension;
    const shots: number[][] = [];
    for (const lacks of [false, true]) {
      WebGL2RenderingContext.prototype.getExtension = function (this: WebGL2RenderingContext, name: string) {
        return lacks && /float/.test(name) ? null : own.call(this, name as never);
      } as typeof own;
      const renderer = makeRenderer();
      const learned = new LearnedScene(await load(), { renderer });
      const scene = new Scene();
      scene.add(learned.root);
      learned.update();
      renderer.render(scene, makeCamera());
      const gl = renderer.getContext();
      const rows = new Uint8Array(4 * WIDTH * HEIGHT);
      gl.readPixels(0, 0, WIDTH, HEIGHT, gl.RGBA, gl.UNSIGNED_BYTE, rows);
      shots.push(Array.from(rows));
      renderer.dispose();
    }
    WebGL2RenderingContext.prototype.getExtension = own;
    return shots;
  },

  /** Two eyes of one camera, as WebXR draws without multiview, and each alone. */
  async eyes(renderer: WebGLRenderer): Promise<Picture[]> {
    const learned = new LearnedScene(await load(), { renderer });
    const scene = new Scene();
    scene.add(learned.root);
    learned.update();
    const eyes = [-0.3, 0.3].map(makeCamera);
    const alone = eyes.map((eye) => draw(renderer, scene, eye));
    eyes.forEach((eye, i) => Object.assign(eye, { viewport: new Vector4(i * WIDTH, 0, WIDTH, HEIGHT) }));
    const both = new ArrayCamera(eyes);
    both.copy(makeCamera() as never, false);
    both.cameras = eyes as never;
    both.updateMatrixWorld();
    const rows = draw(renderer, scene, both, 2 * WIDTH);
    const half = (side: number) => rows.filter((_, i) => Math.floor((i / 3) % (2 * WIDTH) / WIDTH) === side);
    return [...alone, half(0), half(1)];
  },

  /** The lamps of a user add; fog lies over everything. */
  async others(renderer: WebGLRenderer): Promise<Picture[]> {
    const gltf = [await load(), await load(), await load(), await load()];
    const lamp = (scene: Scene) => {
      const light = new PointLight(0xffffff, 2);
      light.position.set(0, 1, 1.5);
      scene.add(light);
    };
    const fog = (scene: Scene) => void (scene.fog = new Fog(0x3366ff, 3.9, 4));
    const alone = new Scene();
    alone.add(gltf[3]!.scene);
    lamp(alone);
    return [show(renderer, gltf[0]!), show(renderer, gltf[1]!, lamp), show(renderer, gltf[2]!, fog), draw(renderer, alone)];
  },

  /** A model that a loader without the plug-in has loaded, with the light of the file. */
  async elsewhere(renderer: WebGLRenderer): Promise<{ pictures: Picture[]; refused: string }> {
    const known = show(renderer, await load());
    const plain = await new GLTFLoader().parseAsync(glb(), "");
    const learned = await loadLight(glb(), plain.scene, { renderer });
    const scene = new Scene();
    scene.add(learned.root);
    learned.update();
    const refused = await loadLight(new TextEncoder().encode("no GLB at all, and not a short one").buffer, plain.scene).then(
      () => "",
      (error: Error) => `${error.name}: ${error.message}`,
    );
    return { pictures: [known, draw(renderer, scene)], refused };
  },
} as const;

export type Scenarios = typeof SCENARIOS;
export type Result<K extends keyof Scenarios> = Awaited<ReturnType<Scenarios[K]>>;

window.scenario = async (name) => {
  const renderer = makeRenderer();
  const result = await SCENARIOS[name as keyof Scenarios](renderer);
  renderer.dispose();
  renderer.forceContextLoss();
  return result;
};
