/** What the user does to the lamps. */

import type { Lamp } from "lightwell";
import type { Color, Vector3 } from "three";
import type { Stage } from "./stage.ts";

/** What has to happen after a change. */
export interface LampEvents {
  /** A lamp moved or shines differently. */
  relit(): void;
  /** There are other lamps than before, for which shaders must be compiled. */
  relamped(): void;
  say(message: string): void;
}

/** Where a lamp is and how it shines. */
export interface LampState {
  /** Number of the declared light that it is a lamp of. */
  readonly variable: number;
  readonly value: Vector3;
  readonly intensity: number;
  readonly color: Color;
}

/** Moves, tints, adds and removes lamps; numbers count the declared lamps first. */
export class LampController {
  private readonly stage: Stage;
  private readonly events: LampEvents;

  constructor(stage: Stage, events: LampEvents) {
    this.stage = stage;
    this.events = events;
  }

  get all(): readonly Lamp[] {
    return this.stage.lamps;
  }

  /** Move a lamp; returns whether the wish was clamped to what was learned. */
  move(index: number, value: Vector3): boolean {
    const clamped = this.all[index]?.move(value) ?? false;
    this.events.relit();
    return clamped;
  }

  setIntensity(index: number, intensity: number): void {
    const lamp = this.all[index];
    if (!lamp) return;
    lamp.intensity = intensity;
    this.events.relit();
  }

  setColor(index: number, color: Color): void {
    this.all[index]?.color.copy(color);
    this.events.relit();
  }

  /** Whether a lamp was added to those of the file. */
  isAdded(index: number): boolean {
    return index >= this.declared;
  }

  /** Add a lamp of the kind of a declared light; returns its number, or -1 when there are enough. */
  add(variable = 0): number {
    if (!this.stage.learned?.addLamp(variable)) {
      const none = this.all[0] === undefined || this.all[0].variable.kind === "environment";
      this.events.say(none ? "This file has no lamp of which there could be more." : "There is no room for another lamp.");
      return -1;
    }
    this.events.relit();
    this.events.relamped();
    return this.all.length - 1;
  }

  /** Take the lamp of this number away, if it was added. */
  remove(index: number): void {
    if (!this.stage.learned?.removeLamp(index)) return;
    this.events.relit();
    this.events.relamped();
  }

  /** The light of the bake: its lamps alone, as they were. */
  reset(): void {
    const before = this.all.length;
    while (this.all.length > this.declared) this.stage.learned?.removeLamp(this.all.length - 1);
    if (this.all.length < before) this.events.relamped();
    this.stage.resetLamps();
  }

  /** All lamps as they are now. */
  states(): readonly LampState[] {
    const variables = this.stage.learned?.variables ?? [];
    return this.all.map((lamp) => ({
      variable: Math.max(0, variables.indexOf(lamp.variable)),
      value: lamp.value.clone(),
      intensity: lamp.intensity,
      color: lamp.color.clone(),
    }));
  }

  /** Bring back lamps that `states` told of. */
  restore(states: readonly LampState[]): void {
    const before = this.all.length;
    for (const [index, state] of states.entries()) {
      if (index >= this.all.length) this.stage.learned?.addLamp(state.variable);
      const lamp = this.all[index];
      lamp?.move(state.value);
      lamp?.color.copy(state.color);
      if (lamp) lamp.intensity = state.intensity;
    }
    if (this.all.length !== before) this.events.relamped();
  }

  private get declared(): number {
    return this.stage.learned?.variables.length ?? 0;
  }
}
