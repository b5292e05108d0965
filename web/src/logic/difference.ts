import type { Ring } from "../live/ring";
import type { Quat } from "./angles";

/** A number that can be read of a row; `wraps` is a full turn in its unit, 0 when it does not jump back. */
export interface Quantity {
  readonly wraps: number;
  readonly read: (ring: Ring, i: number) => number;
}

export interface Known {
  readonly tS: number;
  readonly value: number;
}

const UNKNOWN: Known = { tS: NaN, value: NaN };
/** Messages of one lane come in turns: a value counts until this long after its row. */
const STANDS_S = 0.5;
/** Lanes whose newest values lie further apart in time are not compared. */
const TOGETHER_S = 1;

/** Total angle between two orientations. */
export function angleBetween(a: Quat, b: Quat): number {
  const dot = Math.abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]);
  return Number.isNaN(dot) ? NaN : 2 * Math.acos(Math.min(1, dot));
}

/** The same angle within half a turn of zero; `turn` 0 leaves any number alone. */
export function wrapped(value: number, turn: number): number {
  return turn > 0 ? value - turn * Math.round(value / turn) : value;
}

/** The newest value that is known, at most half a second older than the newest row. */
export function newestKnown(ring: Ring, { read }: Quantity): Known {
  const times = ring.times();
  for (let i = ring.length - 1; i >= 0 && ring.newestS - (times[i] ?? NaN) <= STANDS_S; i--) {
    const value = read(ring, i);
    if (!Number.isNaN(value)) return { tS: times[i] ?? NaN, value };
  }
  return UNKNOWN;
}

/**
 * The value at a moment, between the known ones on either side; NaN when there are none near.
 * Undefined while the one after may still arrive.
 */
export function valueAround(ring: Ring, tS: number, { read, wraps }: Quantity): number | undefined {
  const times = ring.times();
  const at = ring.indexAt(tS);
  const near = (i: number): boolean => Math.abs((times[i] ?? NaN) - tS) <= STANDS_S;
  let i = at;
  while (near(i) && Number.isNaN(read(ring, i))) i--;
  const before = near(i) ? read(ring, i) : NaN;
  if (times[i] === tS && !Number.isNaN(before)) return before;
  let j = at + 1;
  while (near(j) && Number.isNaN(read(ring, j))) j++;
  if (!near(j)) return ring.newestS < tS + STANDS_S ? undefined : NaN;
  const [t0, t1] = [times[i] ?? NaN, times[j] ?? NaN];
  return before + wrapped(read(ring, j) - before, wraps) * ((tS - t0) / (t1 - t0));
}

/** How much more a lane says than another at the newest moment that both know; NaN when one does not. */
export function differenceOf(ring: Ring, other: Ring, quantity: Quantity): number {
  const [mine, theirs] = [newestKnown(ring, quantity).tS, newestKnown(other, quantity).tS];
  if (!(Math.abs(mine - theirs) <= TOGETHER_S)) return NaN;
  const tS = Math.min(mine, theirs);
  const [a, b] = [valueAround(ring, tS, quantity), valueAround(other, tS, quantity)];
  return a === undefined || b === undefined ? NaN : wrapped(a - b, quantity.wraps);
}
