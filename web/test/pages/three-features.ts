/** Features of three.js beside learned light: other kinds of meshes, cameras and renderers, and the light of others. */

import {
  ArrayCamera,
  BufferAttribute,
  Bone,
  type BufferGeometry,
  type Camera,
  Fog,
  InstancedMesh,
  Matrix4,
  Mesh,
  type Object3D,
  Plane,
  PointLight,
  Scene,
  Skeleton,
  SkinnedMesh,
  Vector3,
  Vector4,
} from "three";
import { type GLTF, GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { ClippingGroup } from "three/webgpu";
import { bytesOf, HEIGHT, load, makeCamera, makeStand, offer, type Picture, type Stand, WIDTH } from "./stand.ts";

/** Light a file and draw it. */
function show(stand: Stand, gltf: GLTF, prepare: (scene: Scene, root: Object3D) => void = () => {}, camera?: Camera): Promise<Picture> {
  const learned = stand.light(gltf);
  const scene = new Scene();
  scene.add(learned.root);
  prepare(scene, learned.root);
  learned.update();
  return stand.draw(scene, camera);
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
  async meshes(stand: Stand): Promise<Picture[]> {
    const pictures: Picture[] = [];
    for (const make of [moved, instanced, skinned, morphed, (ball: Mesh) => ball]) pictures.push(await show(stand, await replaced(make)));
    return pictures;
  },

  /** Everything left of the middle is cut away: by the renderer, or with WebGPURenderer by a group. */
  async clipping(stand: Stand): Promise<Picture[]> {
    const whole = await show(stand, await load());
    const clippingPlanes = [new Plane(new Vector3(1, 0, 0), 0)];
    if (stand.webgl) Object.assign(stand.webgl, { clippingPlanes });
    const group = Object.assign(new ClippingGroup(), { clippingPlanes, clipShadows: true });
    const cut = await show(stand, await load(), (scene, root) => void (stand.webgpu && scene.add(group.add(root))));
    return [whole, cut];
  },

  /** With a logarithmic depth buffer, and without. */
  async depth(stand: Stand): Promise<Picture[]> {
    const plain = await show(stand, await load());
    const logarithmic = await stand.another({ logarithmicDepthBuffer: true });
    const pictures = [plain, await show(logarithmic, await load())];
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
      const stand = await makeStand("webgl");
      const learned = stand.light(await load());
      const scene = new Scene();
      scene.add(learned.root);
      learned.update();
      stand.webgl!.render(scene, makeCamera());
      const gl = stand.webgl!.getContext();
      const rows = new Uint8Array(4 * WIDTH * HEIGHT);
      gl.readPixels(0, 0, WIDTH, HEIGHT, gl.RGBA, gl.UNSIGNED_BYTE, rows);
      shots.push(Array.from(rows));
      stand.renderer.dispose();
    }
    WebGL2RenderingContext.prototype.getExtension = own;
    return shots;
  },

  /** Two eyes of one camera, as WebXR draws without multiview, and each alone. */
  async eyes(stand: Stand): Promise<Picture[]> {
    const learned = stand.light(await load());
    const scene = new Scene();
    scene.add(learned.root);
    learned.update();
    const eyes = [-0.3, 0.3].map(makeCamera);
    const alone: Picture[] = [];
    for (const eye of eyes) alone.push(await stand.draw(scene, eye));
    eyes.forEach((eye, i) => Object.assign(eye, { viewport: new Vector4(i * WIDTH, 0, WIDTH, HEIGHT) }));
    const both = new ArrayCamera(eyes);
    both.copy(makeCamera() as never, false);
    both.cameras = eyes as never;
    both.updateMatrixWorld();
    const rows = await stand.draw(scene, both, 2 * WIDTH);
    const half = (side: number) => rows.filter((_, i) => Math.floor((i / 3) % (2 * WIDTH) / WIDTH) === side);
    return [...alone, half(0), half(1)];
  },

  /** The lamps of a user add; fog lies over everything. */
  async others(stand: Stand): Promise<Picture[]> {
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
    return [await show(stand, gltf[0]!), await show(stand, gltf[1]!, lamp), await show(stand, gltf[2]!, fog), await stand.draw(alone)];
  },

  /** A model that a loader without the plug-in has loaded, with the light of the file. */
  async elsewhere(stand: Stand): Promise<{ pictures: Picture[]; refused: string }> {
    const known = await show(stand, await load());
    const plain = await new GLTFLoader().parseAsync(bytesOf(), "");
    const learned = await stand.loadLight(bytesOf(), plain.scene);
    const scene = new Scene();
    scene.add(learned.root);
    learned.update();
    const refused = await stand.loadLight(new TextEncoder().encode("no GLB at all, and not a short one").buffer, plain.scene).then(
      () => "",
      (error: Error) => `${error.name}: ${error.message}`,
    );
    return { pictures: [known, await stand.draw(scene)], refused };
  },
} as const;

export type Scenarios = typeof SCENARIOS;
export type Result<K extends keyof Scenarios> = Awaited<ReturnType<Scenarios[K]>>;

offer(SCENARIOS);
