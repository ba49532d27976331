/** Sizes whose Fourier transform is fast. */

const RADICES = [4, 5, 3, 2] as const;

/** Radices of a transform, largest strides last; null where n has a prime factor above 5. */
export function radices(n: number): number[] | null {
  const found: number[] = [];
  let rest = n;
  for (const r of RADICES) {
    while (rest % r === 0) {
      found.push(r);
      rest /= r;
    }
  }
  return rest === 1 ? found : null;
}

/** The next even size >= n of the form 2^a 3^b 5^c. */
export function fastSize(n: number): number {
  let size = Math.max(8, Math.ceil(n / 2) * 2);
  while (!radices(size)) size += 2;
  return size;
}
