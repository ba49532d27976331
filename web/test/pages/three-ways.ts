/** What users of three.js do to a scene with learned light, and the pictures that come of it. */

import {
  BufferGeometry,
  Color,
  DataTexture,
  EquirectangularReflectionMapping,
  FloatType,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  type MeshPhysicalMaterial,
  MeshStandardMaterial,
  type Object3D,
  OrthographicCamera,
  PointLight,
  Points,
  PointsMaterial,
  Quaternion,
  RGBAFormat,
  Scene,
  Vector3,
} from "three";
import { float, materialColor, output, vec3, vec4 } from "three/tsl";
import { MeshPhysicalNodeMaterial } from "three/webgpu";
import { HEIGHT, load, makeCamera, offer, type Picture, type Stand, WIDTH } from "./stand.ts";

async function put(stand: Stand, options: Parameters<Stand["light"]>[1] = {}, file?: string) {
  const gltf = await load(file);
  const learned = stand.light(gltf, options);
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

/** Put that hook on a material, or none: with WebGPURenderer it is an `outputNode`. */
function redden({ webgl }: Stand, material: MeshStandardMaterial, on: boolean): void {
  if (webgl) material.onBeforeCompile = on ? redder : () => {};
  else Object.assign(material, { outputNode: on ? output.add(vec4(0.25, 0, 0, 0)) : null });
  material.needsUpdate = true;
}

/** White light from everywhere. */
function whiteSky(): DataTexture {
  const texture = new DataTexture(new Float32Array(4 * 64 * 32).fill(1), 64, 32, RGBAFormat, FloatType);
  texture.mapping = EquirectangularReflectionMapping;
  texture.needsUpdate = true;
  return texture;
}

/** Each with a renderer of its own. */
const SCENARIOS = {
  /** As it is loaded, somewhere else in another orientation and size, and there within groups of their own. */
  async placed(stand: Stand): Promise<Picture[]> {
    const { learned, scene } = await put(stand);
    learned.update();
    const pictures = [await stand.draw(scene)];
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
    pictures.push(await stand.draw(scene, camera));
    return pictures;
  },

  async uneven(stand: Stand): Promise<string> {
    const { learned } = await put(stand);
    learned.root.scale.set(1, 2, 1);
    try {
      learned.update();
      return "";
    } catch (error) {
      return (error as Error).message;
    }
  },

  /** `move`, the light's own position, and a light that hangs elsewhere; colour and intensity both ways. */
  async lamp(stand: Stand): Promise<{ pictures: Picture[]; clamped: number[] }> {
    const { learned, scene } = await put(stand);
    const [lamp] = learned.lamps;
    const light = lamp!.object as PointLight;
    const home = lamp!.value.clone();
    const place = new Vector3(0.4, 0.8, 0.3);
    const pictures: Picture[] = [];
    const take = async () => {
      learned.update();
      pictures.push(await stand.draw(scene));
    };
    lamp!.move(place);
    lamp!.intensity *= 2;
    lamp!.color.set(1, 0.5, 0.25);
    await take();
    lamp!.move(home);
    await take();
    light.position.copy(place);
    await take();
    light.position.copy(home);
    const arm = new Group();
    arm.position.set(0.1, 0.2, 0);
    arm.rotation.set(0.3, 0.2, 0.1);
    scene.add(arm.add(light));
    light.position.copy(arm.worldToLocal(place.clone()));
    arm.updateMatrixWorld();
    light.position.copy(arm.worldToLocal(place.clone()));
    await take();
    light.position.copy(arm.worldToLocal(new Vector3(0, 50, 0)));
    learned.update();
    const clamped = lamp!.value.toArray();
    learned.root.add(light);
    light.position.copy(home);
    light.intensity /= 2;
    light.color.set(1, 0.9, 0.8);
    await take();
    return { pictures, clamped };
  },

  /** With the user's hook from before, with none, with the hook from after, and with the hook alone. */
  async hooks(stand: Stand): Promise<Picture[]> {
    const gltf = await load();
    for (const material of materialsOf(gltf.scene)) redden(stand, material, true);
    const learned = stand.light(gltf);
    const scene = new Scene();
    scene.add(learned.root);
    const set = (on: boolean) => {
      for (const material of materialsOf(learned.root)) redden(stand, material, on);
    };
    learned.update();
    const pictures = [await stand.draw(scene)];
    set(false);
    pictures.push(await stand.draw(scene));
    set(true);
    pictures.push(await stand.draw(scene));
    learned.dispose();
    pictures.push(await stand.draw(scene));
    return pictures;
  },

  /** Edits of the file's materials, at full and at half resolution. */
  async edits(stand: Stand): Promise<Record<string, number[][]>> {
    const { learned, scene } = await put(stand);
    const at = 3 * (WIDTH * (HEIGHT / 2) + WIDTH / 2);
    const middle = (picture: Picture) => picture.slice(at, at + 3);
    const looks = async (): Promise<number[][]> => {
      learned.update();
      const full = middle(await stand.draw(scene));
      const half = middle(await stand.drawLook(learned, scene, { half: true, segments: false }));
      await stand.drawLook(learned, scene, { half: false, segments: false });
      return [full, half];
    };
    const plain = await looks();
    for (const material of materialsOf(learned.root)) material.emissive.set(0.5, 0, 0);
    const lit = await looks();
    const green = new MeshStandardMaterial({ color: 0, emissive: new Color(0, 1, 0) });
    learned.root.traverse((object) => {
      if (object instanceof Mesh) object.material = green;
    });
    const other = await looks();
    return Object.fromEntries(plain.map((_, i) => [["full", "half"][i], [plain[i], lit[i], other[i]]]));
  },

  /**
   * With the file's materials and with materials of nodes in their place; with other numbers in the file's materials and in those of nodes,
   * and with nodes that say the same; without and with a glow that a node says before and after the material is lit, and whether it is left.
   */
  async nodes(stand: Stand): Promise<{ plain: Picture[]; numbers: Picture[]; glowing: Picture[]; left: boolean[] }> {
    const { gltf, learned, scene } = await put(stand);
    const originals = new Map<Mesh, MeshPhysicalMaterial>();
    gltf.scene.traverse((object) => void (object instanceof Mesh && originals.set(object, object.material)));
    const shown = async (make: (material: MeshPhysicalMaterial) => object): Promise<Picture> => {
      const made = new Map(Array.from(new Set(originals.values()), (material) => [material, make(material)]));
      for (const [mesh, material] of originals) mesh.material = made.get(material) as MeshPhysicalMaterial;
      learned.update();
      return stand.draw(scene);
    };
    const ofNodes = ({ color, metalness, roughness, specularIntensity = 1, side }: MeshPhysicalMaterial) =>
      new MeshPhysicalNodeMaterial({ color, metalness, roughness, specularIntensity, side });
    const halved = <M extends { color: Color }>(material: M): M => {
      material.color.multiplyScalar(0.5);
      return Object.assign(material, { metalness: 0.25, roughness: 0.6 });
    };
    const said = (material: object) => Object.assign(material, { colorNode: materialColor.mul(0.5), metalnessNode: float(0.25), roughnessNode: float(0.6) });
    const glow = { emissiveNode: vec3(0.5, 0, 0), needsUpdate: true };
    const plain = [await shown((material) => material), await shown(ofNodes)];
    const numbers = [
      await shown((material) => halved(material.clone())),
      await shown((material) => halved(ofNodes(material))),
      await shown((material) => said(ofNodes(material))),
      await shown((material) => said(material.clone())),
    ];
    const glowing = [await shown((material) => Object.assign(material.clone(), glow)), await shown((material) => Object.assign(ofNodes(material), glow))];
    const last = materialsOf(learned.root);
    for (const material of last) Object.assign(material, { emissiveNode: null, needsUpdate: true });
    glowing.unshift(await stand.draw(scene));
    for (const material of last) Object.assign(material, glow);
    glowing.push(await stand.draw(scene));
    // Copies of materials that are lit already.
    for (const mesh of originals.keys()) mesh.material = (mesh.material as MeshPhysicalMaterial).clone();
    learned.update();
    glowing.push(await stand.draw(scene));
    learned.dispose();
    const left = [...last, ...materialsOf(learned.root)].map((material) => (material as unknown as MeshPhysicalNodeMaterial).emissiveNode === glow.emissiveNode);
    return { plain, numbers, glowing, left };
  },

  /** Before, with learned light, after `dispose`, and what is left of it. */
  async restored(stand: Stand): Promise<{ pictures: Picture[]; left: unknown; first: unknown }> {
    const gltf = await load();
    gltf.scene.add(new PointLight(0xffffff, 3));
    gltf.scene.children.at(-1)!.position.set(0, 1, 0);
    const state = () => {
      const materials = materialsOf(gltf.scene);
      const nodes: string[] = [];
      gltf.scene.traverse((object) => void nodes.push(`${object.type} ${object.castShadow} ${object.receiveShadow}`));
      return { nodes, sides: materials.map(({ shadowSide }) => shadowSide), own: materials.map((material) => Object.keys(material).filter((name) => !name.startsWith("_")).sort()) };
    };
    const scene = new Scene();
    scene.add(gltf.scene);
    const first = state();
    const pictures = [await stand.draw(scene)];
    const learned = stand.light(gltf);
    learned.update();
    pictures.push(await stand.draw(scene));
    learned.dispose();
    pictures.push(await stand.draw(scene));
    const left = state();
    learned.attach();
    learned.update();
    pictures.push(await stand.draw(scene));
    return { pictures, left, first };
  },

  /** With the lamp's shadow, without it, and with it again. */
  async shadows(stand: Stand): Promise<Picture[]> {
    const { learned, scene } = await put(stand);
    const light = learned.lamps[0]!.object as PointLight;
    const pictures: Picture[] = [];
    for (const on of [true, false, true]) {
      light.castShadow = on;
      learned.update();
      pictures.push(await stand.draw(scene));
    }
    return pictures;
  },

  /** How often a texture of the model is freed: by a scene that leaves textures, and by one that does not. */
  async textures(stand: Stand): Promise<number[]> {
    const { gltf, learned } = await put(stand);
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
  async twice(stand: Stand): Promise<{ pictures: Picture[]; lights: number }> {
    const { gltf, learned, scene } = await put(stand);
    learned.update();
    const pictures = [await stand.draw(scene)];
    const second = stand.light(gltf);
    learned.update();
    second.update();
    pictures.push(await stand.draw(scene));
    let lights = 0;
    scene.traverse((object) => void (lights += object instanceof PointLight ? 1 : 0));
    learned.dispose();
    pictures.push(await stand.draw(scene));
    const other = await put(stand);
    other.learned.lamps[0]!.intensity = 1;
    other.learned.update();
    pictures.push(await stand.draw(other.scene));
    pictures.push(await stand.draw(scene));
    return { pictures, lights };
  },

  /** Meshes are given a material of another scene: what `update` and `attach` say, and the objects that the latter leaves. */
  async shared(stand: Stand): Promise<{ messages: string[]; left: number }> {
    const [one, other] = [await put(stand), await put(stand)];
    const [material] = materialsOf(other.learned.root);
    material!.name = "paint";
    const { root } = one.learned;
    root.traverse((object) => {
      if (object instanceof Mesh) object.material = material;
    });
    const objects = (): number => {
      let count = 0;
      root.traverse(() => void count++);
      return count;
    };
    const message = (act: () => void): string => {
      try {
        act();
        return "";
      } catch (error) {
        return (error as Error).message;
      }
    };
    const said = message(() => one.learned.update());
    one.learned.detach();
    const before = objects();
    return { messages: [said, message(() => one.learned.attach())], left: objects() - before };
  },

  /** A second renderer, then a lost device: a context is restored, and for a `GPUDevice` there is a new renderer. */
  async renderers(stand: Stand): Promise<Picture[]> {
    const { learned, scene } = await put(stand);
    const other = await stand.another();
    const pictures: Picture[] = [];
    for (const one of [stand, other, stand, other]) {
      one.update(learned);
      pictures.push(await one.draw(scene));
    }
    learned.lamps[0]!.move(new Vector3(0.4, 0.8, 0.3));
    for (const one of [stand, other]) {
      one.update(learned);
      pictures.push(await one.draw(scene));
    }
    other.dispose();
    const back = await stand.loseDevice();
    back.update(learned);
    pictures.push(await back.draw(scene));
    return pictures;
  },

  async environments(stand: Stand): Promise<Picture[]> {
    const pictures: Picture[] = [];
    const sky = whiteSky();
    for (const [policy, lit] of [["remove", false], ["remove", true], ["keep", true]] as const) {
      const { learned, scene } = await put(stand, { environment: policy });
      if (lit) scene.environment = sky;
      learned.update();
      pictures.push(await stand.draw(scene));
      learned.dispose();
    }
    return pictures;
  },

  /** A parallel view, of a field that shows the direction to the eye; and what that is. */
  async parallel(stand: Stand): Promise<{ picture: Picture; direction: number[] }> {
    const { learned, scene } = await put(stand, {}, "views");
    learned.update();
    const camera = new OrthographicCamera(-0.5, 0.5, 0.375, -0.375, 0.1, 20);
    camera.position.set(1, 2, 5);
    camera.lookAt(0, 1, 0);
    return { picture: await stand.draw(scene, camera), direction: camera.getWorldDirection(new Vector3()).negate().toArray() };
  },

  async cycles(stand: Stand): Promise<object[]> {
    const seen = [];
    for (let i = 0; i < Number(document.body.dataset.cycles ?? 6); i++) {
      const { learned, scene } = await put(stand);
      learned.update();
      await stand.draw(scene);
      learned.dispose();
      seen.push({ ...stand.renderer.info.memory, ...(stand.webgl ? { programs: stand.webgl.info.programs!.length } : {}) });
    }
    return seen;
  },

  /** What a renderer holds after a scene was drawn and given back, in every order of detaching and disposing; lines and points too. */
  async orders(stand: Stand): Promise<object[]> {
    const seen = [];
    for (const order of ["dispose", "dispose", "detach dispose", "dispose detach", "detach detach dispose dispose", "detach draw dispose", "dispose draw dispose"]) {
      const gltf = await load();
      const corners = () => new BufferGeometry().setFromPoints([new Vector3(0, 0.5, 0), new Vector3(0.5, 1, 0)]);
      gltf.scene.add(new LineSegments(corners(), new LineBasicMaterial()), new Points(corners(), new PointsMaterial()));
      const learned = stand.light(gltf);
      const scene = new Scene();
      scene.add(learned.root);
      learned.update();
      await stand.draw(scene);
      for (const step of order.split(" ")) {
        if (step === "draw") await stand.draw(scene);
        else learned[step as "detach" | "dispose"]();
      }
      seen.push({ ...stand.renderer.info.memory, ...(stand.webgl ? { programs: stand.webgl.info.programs!.length } : {}) });
    }
    return seen;
  },

  /** A user's hook that takes away what the finish needs. */
  async broken(stand: Stand): Promise<string> {
    const { learned, scene } = await put(stand);
    for (const material of materialsOf(learned.root))
      material.onBeforeCompile = (shader) => {
        shader.fragmentShader = shader.fragmentShader.replace("#include <opaque_fragment>", "");
      };
    learned.update();
    try {
      await stand.draw(scene);
      return "";
    } catch (error) {
      return (error as Error).message;
    }
  },
} as const;

export type Scenarios = typeof SCENARIOS;
export type Result<K extends keyof Scenarios> = Awaited<ReturnType<Scenarios[K]>>;

offer(SCENARIOS);
