/** The page of a probe volume: an object dragged through the scene, probes, weights, and the light that trilinear weights leak. */

import { type ProbeUse, ProbeVolume } from "lightwell/probes";
import {
  AgXToneMapping,
  Box3,
  Color,
  FrontSide,
  InstancedMesh,
  type Material,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  type Object3D,
  PerspectiveCamera,
  Plane,
  Raycaster,
  Scene,
  SphereGeometry,
  TorusKnotGeometry,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { readCore } from "../runtime/src/core-record.ts";
import { clippingPlanes, coreOf } from "../runtime/src/core.ts";
import { half } from "../runtime/src/probes/file.ts";
import { meteredExposure } from "./exposure.ts";

const bytesIn = (id: string): ArrayBuffer => {
  const text = document.getElementById(id)?.textContent;
  if (!text) throw new Error(`probes: the page holds no ${id}`);
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer as ArrayBuffer;
};

/** Irradiance of band 0 of a probe, any colour. */
function mean(volume: ProbeVolume, probe: number): number {
  const { words, at, unit } = volume.file;
  const first = 4 * at.light + 8 * probe;
  const numbers = [words[first]! & 0xffff, words[first]! >>> 16, words[first + 1]! & 0xffff];
  return (unit * 0.2820948 * numbers.reduce((sum, bits) => sum + half(bits), 0)) / 3;
}

class Page {
  readonly volume = new ProbeVolume(bytesIn("lightwell-volume"));
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(38, 1, 0.05, 200);
  readonly object = new Mesh(new TorusKnotGeometry(0.19, 0.075, 160, 24), new MeshStandardMaterial({ color: 0xdddddd, roughness: 0.9 }));
  private readonly canvas = document.querySelector("canvas")!;
  private readonly form = document.querySelector("form")!;
  private readonly renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, preserveDrawingBuffer: true });
  private readonly controls = new OrbitControls(this.camera, this.canvas);
  private readonly uses: ProbeUse[] = [];
  private readonly nodes: number[] = [];
  private readonly marks: InstancedMesh;
  private readonly bounds = new Box3();
  private exposure = 1;
  private stale = true;

  constructor() {
    const { volume } = this;
    const [nx, ny, nz] = volume.file.shape;
    for (let k = 0; k < nx * ny * nz; k++) if (volume.alive(k)) this.nodes.push(k);
    this.exposure = meteredExposure(this.nodes.map((k) => mean(volume, k)));
    this.marks = new InstancedMesh(new SphereGeometry(0.035 * volume.file.spacing, 10, 6), new MeshBasicMaterial(), this.nodes.length);
    this.marks.visible = false;
    this.renderer.toneMapping = AgXToneMapping;
    this.scene.background = new Color(0x16171a);
    this.uses.push(volume.light(this.object.material));
    this.scene.add(this.object, this.marks);
  }

  async start(): Promise<void> {
    const { scene, parser } = await new GLTFLoader().parseAsync(bytesIn("lightwell-scene"), "");
    const lights: Object3D[] = [];
    const seen = new Set<Material>();
    scene.traverse((part) => {
      if ((part as { isLight?: boolean }).isLight) lights.push(part);
      if (!(part instanceof Mesh)) return;
      for (const material of [part.material].flat() as Material[]) {
        if (seen.has(material)) continue;
        seen.add(material);
        // Walls are seen from inside alone: the scene is a doll's house.
        material.side = FrontSide;
        this.uses.push(this.volume.light(material, true));
      }
    });
    for (const light of lights) light.removeFromParent();
    this.scene.add(scene);
    const all = new Box3().setFromObject(scene);
    // The part that is looked at, without a dome of sky, where the file says so.
    const declared = (parser.json as { extensions?: Record<string, { core?: unknown }> }).extensions?.LIGHTWELL_neural_radiance?.core;
    this.bounds.copy(coreOf(readCore(declared, "core"), all));
    [this.camera.near, this.camera.far] = clippingPlanes(this.bounds, all);
    const middle = this.bounds.getCenter(new Vector3());
    const size = this.bounds.getSize(new Vector3());
    this.camera.position.copy(middle).add(new Vector3(0.1, 1.05, 0.95).multiplyScalar(0.95 * Math.max(size.x, size.z) * Math.max(1, (1.1 * innerHeight) / innerWidth)));
    this.controls.target.copy(middle);
    this.controls.update();
    // Distance moments, where the volume holds them.
    this.form.querySelector<HTMLElement>(".baseline")!.hidden = !this.volume.file.baselines;
    this.form.addEventListener("input", () => this.follow());
    this.controls.addEventListener("change", () => this.redraw());
    addEventListener("resize", () => this.redraw());
    this.drag();
    this.follow();
  }

  /** Take over what the form says. */
  private follow(): void {
    const value = (name: string) => Number(new FormData(this.form).get(name) ?? 0);
    const way = value("way");
    if (way !== this.way) this.move(this.along(way));
    this.way = way;
    for (const use of this.uses) {
      use.mode.value = value("mode");
      use.view.value = value("view");
    }
    this.marks.visible = (this.form.elements.namedItem("probes") as HTMLInputElement).checked;
    this.renderer.toneMappingExposure = this.exposure * 2 ** value("stops");
    // The leak view compares with the chosen weights, or with trilinear ones.
    const other = value("mode") || 2;
    for (const use of this.uses) use.other.value = other;
    const told = this.form.querySelector<HTMLElement>(".leak")!;
    told.hidden = value("view") !== 3;
    told.querySelector("b")!.textContent = ["", "trilinear + validity", "trilinear", "DDGI"][other]!;
    this.redraw();
  }

  private way = -1;

  /** A place on the way through the scene: along x at two thirds of z, where the built-in doorway is. */
  private along(t: number): Vector3 {
    const { min, max } = this.bounds;
    return new Vector3(min.x + (max.x - min.x) * (0.08 + 0.84 * t), min.y + 1.1, min.z + 0.483 * (max.z - min.z));
  }

  /** Put the object somewhere, and name the probe that is nearest. */
  move(place: Vector3): void {
    this.object.position.copy(place);
    const [first] = [...this.nodes].sort((a, b) => place.distanceTo(new Vector3(...this.volume.node(a))) - place.distanceTo(new Vector3(...this.volume.node(b))));
    for (const use of this.uses) use.probe.value = first ?? -1;
    const at = new Matrix4();
    this.nodes.forEach((k, i) => {
      const near = k === first;
      at.makeScale(near ? 2 : 1, near ? 2 : 1, near ? 2 : 1).setPosition(...this.volume.node(k));
      this.marks.setMatrixAt(i, at);
      const light = (mean(this.volume, k) / Math.PI) * this.exposure;
      this.marks.setColorAt(i, near ? new Color(1, 0.55, 0.05) : new Color(light, light, light).addScalar(0.02));
    });
    this.marks.instanceMatrix.needsUpdate = true;
    if (this.marks.instanceColor) this.marks.instanceColor.needsUpdate = true;
    this.form.querySelector("output")!.textContent = `Object at ${place.toArray().map((v) => v.toFixed(2)).join(", ")} m; nearest probe ${first}`;
    this.redraw();
  }

  /** The object follows the pointer on its own height. */
  private drag(): void {
    const [ray, plane, hit] = [new Raycaster(), new Plane(), new Vector3()];
    let held = false;
    const aim = (event: PointerEvent) => {
      const at = new Vector2((2 * event.clientX) / innerWidth - 1, 1 - (2 * event.clientY) / innerHeight);
      ray.setFromCamera(at, this.camera);
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      aim(event);
      held = ray.intersectObject(this.object).length > 0;
      this.controls.enabled = !held;
      if (held) plane.setFromNormalAndCoplanarPoint(new Vector3(0, 1, 0), this.object.position);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!held) return;
      aim(event);
      if (ray.ray.intersectPlane(plane, hit)) this.move(this.bounds.clampPoint(hit, hit).clone());
    });
    for (const name of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(name, () => {
        held = false;
        this.controls.enabled = true;
      });
    }
  }

  private redraw(): void {
    if (!this.stale) return;
    this.stale = false;
    requestAnimationFrame(() => {
      this.stale = true;
      this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
      this.renderer.setSize(innerWidth, innerHeight, false);
      this.camera.aspect = innerWidth / innerHeight;
      // The scene stands beside the form, or above it.
      if (innerWidth > 700) this.camera.setViewOffset(innerWidth, innerHeight, -130, 0, innerWidth, innerHeight);
      else this.camera.setViewOffset(innerWidth, innerHeight, 0, 0.2 * innerHeight, innerWidth, innerHeight);
      this.camera.updateProjectionMatrix();
      this.renderer.render(this.scene, this.camera);
    });
  }
}

const page = new Page();
declare global {
  interface Window {
    lightwellProbes: { page: Page; ready: Promise<void> };
  }
}
window.lightwellProbes = { page, ready: page.start() };
