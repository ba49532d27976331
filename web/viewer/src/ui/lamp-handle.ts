/** A handle over a point lamp: drag it in the camera plane, wheel or keys for depth. */

import { Plane, Raycaster, Vector2, Vector3 } from "three";
import { needsReference } from "../presenter.ts";
import type { Viewer } from "../viewer.ts";
import { el } from "./dom.ts";
import { hexOf, lampName } from "./light-controls.ts";

/** A lamp outside of the picture is shown at its rim: distance from there, CSS pixels. */
const RIM = 30;

/** Share of the box's diagonal that one key press or wheel notch moves. */
const STEP = 0.02;

const KEYS: Record<string, readonly [right: number, up: number, forward: number]> = {
  ArrowLeft: [-1, 0, 0],
  ArrowRight: [1, 0, 0],
  ArrowUp: [0, 1, 0],
  ArrowDown: [0, -1, 0],
  PageUp: [0, 0, 1],
  PageDown: [0, 0, -1],
};

export class LampHandle {
  readonly element: HTMLButtonElement;
  private readonly viewer: Viewer;
  private readonly index: number;
  private readonly plane = new Plane();
  private readonly raycaster = new Raycaster();
  /** From the pointer to the handle's centre when the drag began, CSS pixels. */
  private readonly grip = new Vector2();
  private clamped = false;

  constructor(viewer: Viewer, index: number) {
    this.viewer = viewer;
    this.index = index;
    const name = lampName(viewer, index);
    this.element = el("button", {
      type: "button",
      class: "lamp",
      "aria-label": `Light “${name}”. Drag to move; arrow keys move it, page up and page down change its depth.`,
      title: "Drag the light · wheel: nearer, farther",
      onpointerdown: (event: PointerEvent) => this.startDrag(event),
      onpointermove: (event: PointerEvent) => this.drag(event),
      onpointerup: (event: PointerEvent) => this.endDrag(event),
      onpointercancel: (event: PointerEvent) => this.endDrag(event),
      onkeydown: (event: KeyboardEvent) => this.key(event),
    });
    this.element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  /** Follow the lamp on the page. */
  update(): void {
    const { viewer, element } = this;
    // Added lamps are told apart at the rim by their colour.
    if (viewer.lampController.isAdded(this.index))
      element.style.setProperty("--tint", `#${hexOf(viewer.lamps[this.index]!.color)}`);
    const at = this.lamp.clone().project(viewer.rig.camera);
    const { clientWidth, clientHeight } = viewer.canvas;
    element.hidden = needsReference(viewer) || viewer.mode === "experts" || at.z > 1;
    const [x, y] = [((at.x + 1) / 2) * clientWidth, ((1 - at.y) / 2) * clientHeight];
    const [px, py] = [within(x, clientWidth), within(y, clientHeight)];
    const away = Math.hypot(x - px, y - py) > RIM;
    element.classList.toggle("away", away);
    if (away) element.style.setProperty("--bearing", `${Math.atan2(y - py, x - px).toFixed(3)}rad`);
    const [left, top] = away ? [px, py] : [x, y];
    element.style.transform = `translate(${left.toFixed(1)}px, ${top.toFixed(1)}px)`;
  }

  private get lamp(): Vector3 {
    return this.viewer.lamps[this.index]!.value;
  }

  private startDrag(event: PointerEvent): void {
    const box = this.element.getBoundingClientRect();
    this.grip.set((box.left + box.right) / 2 - event.clientX, (box.top + box.bottom) / 2 - event.clientY);
    const forward = this.viewer.rig.camera.getWorldDirection(new Vector3());
    this.plane.setFromNormalAndCoplanarPoint(forward, this.lamp);
    this.element.setPointerCapture(event.pointerId);
    this.element.classList.add("dragging");
  }

  private drag(event: PointerEvent): void {
    if (!this.element.hasPointerCapture(event.pointerId)) return;
    const box = this.viewer.canvas.getBoundingClientRect();
    const x = ((event.clientX + this.grip.x - box.left) / box.width) * 2 - 1;
    const y = 1 - ((event.clientY + this.grip.y - box.top) / box.height) * 2;
    this.raycaster.setFromCamera(new Vector2(x, y), this.viewer.rig.camera);
    const point = this.raycaster.ray.intersectPlane(this.plane, new Vector3());
    if (point) this.move(point);
  }

  private endDrag(event: PointerEvent): void {
    this.element.releasePointerCapture(event.pointerId);
    this.element.classList.remove("dragging");
    this.clamped = false;
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    this.shift([0, 0, -Math.sign(event.deltaY)], 1);
    const forward = this.viewer.rig.camera.getWorldDirection(new Vector3());
    this.plane.setFromNormalAndCoplanarPoint(forward, this.lamp);
  }

  private key(event: KeyboardEvent): void {
    if (event.key === "Delete" || event.key === "Backspace") return this.viewer.lampController.remove(this.index);
    const direction = KEYS[event.key];
    if (!direction) return;
    event.preventDefault();
    event.stopPropagation();
    this.clamped = false;
    this.shift(direction, event.shiftKey ? 0.25 : 1);
  }

  /** Move along the camera's axes. */
  private shift([right, up, forward]: readonly [number, number, number], factor: number): void {
    const { variable } = this.viewer.lamps[this.index]!;
    if (variable.kind !== "point") return;
    const step = STEP * factor * new Vector3(...variable.low).distanceTo(new Vector3(...variable.high));
    const matrix = this.viewer.rig.camera.matrixWorld;
    const offset = new Vector3(right, up, -forward)
      .multiplyScalar(step)
      .transformDirection(matrix)
      .multiplyScalar(step);
    this.move(this.lamp.clone().add(offset));
  }

  private move(point: Vector3): void {
    const clamped = this.viewer.lampController.move(this.index, point);
    if (clamped && !this.clamped) this.viewer.say("The light stays inside the space it was learned for.");
    this.clamped = clamped;
    this.element.classList.toggle("clamped", clamped);
  }
}

/** The nearest place that is not too near to the rim. */
function within(x: number, size: number): number {
  return Math.max(RIM, Math.min(size - RIM, x));
}
