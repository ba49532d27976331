/** Random numbers with a seed, the same on every machine. */

/** Chooses among things. */
export interface Random {
  /** In [0, 1). */
  real(): number;
  /** A whole number in [0, count). */
  below(count: number): number;
  /** One of some things; there must be one. */
  of<T>(things: readonly T[]): T;
}

/** Mulberry32 (T. Ettinger, 2017, public domain). */
export function randomOf(seed: number): Random {
  let state = seed >>> 0;
  const real = () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = Math.imul(state ^ (state >>> 15), state | 1);
    t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
  const below = (count: number) => Math.floor(real() * count);
  return { real, below, of: (things) => things[below(things.length)]! };
}
