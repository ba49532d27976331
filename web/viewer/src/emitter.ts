/** Tells listeners that something happened. */
export class Emitter<Events extends Record<string, unknown>> {
  private readonly listeners = new Map<keyof Events, Set<(detail: never) => void>>();

  /** Listen; the returned function ends it. */
  on<K extends keyof Events>(name: K, listener: (detail: Events[K]) => void): () => void {
    const set = this.listeners.get(name) ?? new Set();
    this.listeners.set(name, set.add(listener as (detail: never) => void));
    return () => set.delete(listener as (detail: never) => void);
  }

  protected emit<K extends keyof Events>(name: K, detail: Events[K]): void {
    // A copy: who starts to listen while being told hears of the next event, not of this one.
    for (const listener of [...(this.listeners.get(name) ?? [])])
      (listener as (detail: Events[K]) => void)(detail);
  }
}
