/** Where a baked scene stands in the world: fields were learned in the space of its root. */

import { Box3, type BufferGeometry, Matrix4, type Object3D, Vector3 } from "three";

/** Largest difference of the scales of two axes, and of the cosine between them from 0, that counts as none. */
const TOLERANCE = 1e-3;

/** Follows the world matrix of a root. */
export class Placement {
  readonly root: Object3D;
  /** From the world to the space of the root. */
  readonly toRoot = new Matrix4();
  /** Metres in the world of one metre in the root. */
  scale = 1;
  private readonly seen = new Matrix4();

  constructor(root: Object3D) {
    this.root = root;
  }

  /**
   * Look at the root; returns whether it has moved. Throws when its axes are scaled differently or sheared: directions and
   * distances would mean something else to the fields than they did in the bake.
   */
  follow(): boolean {
    this.root.updateWorldMatrix(true, false);
    const { matrixWorld } = this.root;
    if (matrixWorld.equals(this.seen)) return false;
    const axes = [new Vector3(), new Vector3(), new Vector3()] as const;
    matrixWorld.extractBasis(...axes);
    const [x, y, z] = axes.map((axis) => axis.length()) as [number, number, number];
    const uneven = Math.max(Math.abs(y - x), Math.abs(z - x)) > TOLERANCE * x || !(x > 0);
    const sheared = Math.max(...axes.map((axis, i) => Math.abs(axis.dot(axes[(i + 1) % 3]!)))) > TOLERANCE * x * x;
    if (uneven || sheared) {
      const found = [x, y, z].map((length) => length.toPrecision(3)).join(", ");
      throw new Error(`LearnedScene '${this.root.name}': expected axes of one scale at right angles, found scales ${found}; scale all axes alike`);
    }
    this.seen.copy(matrixWorld);
    this.toRoot.copy(matrixWorld).invert();
    this.scale = x;
    return true;
  }

  /** Whether an object hangs on the root itself, so that its own coordinates are those of the root. */
  holds(object: Object3D): boolean {
    return object.parent === this.root;
  }

  /** Put an object at a point of the root's space, wherever it hangs. */
  put(object: Object3D, point: Vector3): void {
    object.position.copy(point);
    if (this.holds(object) || !object.parent) return;
    object.parent.updateWorldMatrix(true, false);
    object.parent.worldToLocal(this.root.localToWorld(object.position));
  }

  /** The point of the root's space at which an object stands. */
  pointOf(object: Object3D, target: Vector3): Vector3 {
    if (this.holds(object)) {
      if (object.matrixAutoUpdate) return target.copy(object.position);
      return target.setFromMatrixPosition(object.matrix);
    }
    object.updateWorldMatrix(true, false);
    return target.setFromMatrixPosition(object.matrixWorld).applyMatrix4(this.toRoot);
  }
}

/** What has bounds of its own: instances, skins. */
interface Bounded {
  readonly geometry?: BufferGeometry;
  readonly boundingBox?: Box3 | null;
  computeBoundingBox?(): void;
}

/** Bounds of everything drawn under a root, in its own space. */
export function boundsOf(root: Object3D): Box3 {
  root.updateWorldMatrix(true, true);
  const toRoot = root.matrixWorld.clone().invert();
  const bounds = new Box3();
  root.traverse((object) => {
    const { geometry, boundingBox } = object as Bounded;
    if (!geometry) return;
    const holder: Bounded = boundingBox === undefined ? geometry : (object as Bounded);
    if (!holder.boundingBox) holder.computeBoundingBox!();
    bounds.union(holder.boundingBox!.clone().applyMatrix4(object.matrixWorld).applyMatrix4(toRoot));
  });
  return bounds;
}
