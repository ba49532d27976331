/** Something that is not of the file: the file's probes light it, as they would a character or a thing that is carried about. */

import type { LearnedScene } from "lightwell";
import { type Box3, Mesh, MeshStandardMaterial, TorusKnotGeometry, Vector3 } from "three";

/** Its radius as a share of the diagonal of what is looked at, and how much of the way from the eye to what it looks at it stands first. */
const [SIZE, AHEAD] = [0.035, 0.8];
/** How near to the bounds of that it may come, as a share of them. */
const MARGIN = 0.06;

/** A knot that hangs in the air. */
export class TestObject {
  readonly mesh: Mesh;
  /** Whether the user wants to see it. */
  shown = true;
  private readonly bounds: Box3;
  private readonly axis: "x" | "z";

  constructor(bounds: Box3) {
    const size = bounds.getSize(new Vector3());
    const radius = SIZE * size.length();
    const material = new MeshStandardMaterial({ color: 0xe0e0e0, roughness: 0.9, metalness: 0 });
    this.mesh = new Mesh(new TorusKnotGeometry(radius, 0.38 * radius, 160, 24), material);
    this.mesh.name = "test object";
    this.axis = size.x >= size.z ? "x" : "z";
    this.bounds = bounds.clone().expandByVector(size.multiplyScalar(-MARGIN));
    this.move(bounds.getCenter(new Vector3()));
  }

  /** Hang it in the scene and light it. */
  async light(learned: LearnedScene): Promise<void> {
    learned.root.parent?.add(this.mesh);
    await learned.addLit(this.mesh);
  }

  /** Put it between the eye and what it looks at. */
  meet(eye: Vector3, target: Vector3): void {
    this.move(eye.clone().lerp(target, AHEAD));
  }

  /** Put it somewhere inside the scene. */
  move(place: Vector3): void {
    this.mesh.position.copy(this.bounds.clampPoint(place, new Vector3()));
  }

  /** How far it is along the longer side of the scene, 0 to 1. */
  get along(): number {
    const { min, max } = this.bounds;
    return (this.mesh.position[this.axis] - min[this.axis]) / Math.max(max[this.axis] - min[this.axis], 1e-9);
  }

  set along(share: number) {
    const { min, max } = this.bounds;
    this.mesh.position[this.axis] = min[this.axis] + share * (max[this.axis] - min[this.axis]);
  }

  dispose(): void {
    this.mesh.removeFromParent();
    this.mesh.geometry.dispose();
    (this.mesh.material as MeshStandardMaterial).dispose();
  }
}
