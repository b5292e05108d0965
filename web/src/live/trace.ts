import { valueAround, wrapped } from "../logic/difference";
import type { Signal } from "../logic/signals";
import type { Feed } from "./feeds";
import { LATE_S } from "./ring";

/** Times and values of one curve, contiguous and ascending. */
export interface Curve {
  readonly tS: Float64Array;
  readonly values: Float64Array;
}

/**
 * One picked signal as numbers ready to draw: derived values are computed once per row, when it arrives.
 *
 * With another feed it holds the difference to that: row by row, as soon as the other has reached the row's time.
 * Same memory scheme as `Ring`: twice the capacity, compacted when full, so `curve` is a view.
 */
export class Trace {
  readonly signal: Signal;
  private readonly feed: Feed;
  private readonly other: Feed | undefined;
  private readonly tS: Float64Array;
  private readonly values: Float64Array;
  private start = 0;
  private end = 0;
  private epoch = -1;
  private otherEpoch = -1;
  private revision = 0;
  private frozen: Curve | null = null;

  constructor(signal: Signal, feed: Feed, other?: Feed) {
    this.signal = signal;
    this.feed = feed;
    this.other = other;
    this.tS = new Float64Array(2 * feed.ring.capacity);
    this.values = new Float64Array(2 * feed.ring.capacity);
  }

  /** Take over what arrived since the last call. */
  update(): void {
    const { ring } = this.feed;
    const otherEpoch = this.other?.ring.epoch ?? -1;
    if (ring.epoch !== this.epoch || otherEpoch !== this.otherEpoch) {
      this.start = this.end = 0;
      [this.epoch, this.otherEpoch] = [ring.epoch, otherEpoch];
    }
    if (ring.revision !== this.revision) this.forget(this.newestS - LATE_S);
    this.revision = ring.revision;
    const lastS = this.newestS;
    const times = ring.times();
    for (let i = ring.indexAt(lastS) + 1; i < times.length; i++) {
      const value = this.valueAt(i, times[i] ?? NaN);
      if (value === undefined) return;
      this.push(times[i] ?? NaN, value);
    }
  }

  private get newestS(): number {
    return this.end > this.start ? (this.tS[this.end - 1] ?? -Infinity) : -Infinity;
  }

  /** Drop what came from rows that may have changed since. */
  private forget(fromS: number): void {
    while (this.end > this.start && (this.tS[this.end - 1] ?? -Infinity) >= fromS) this.end--;
  }

  /** Undefined while what it is compared with may still arrive. */
  private valueAt(i: number, tS: number): number | undefined {
    const value = this.signal.read(this.feed.ring, i);
    if (!this.other || Number.isNaN(value)) return value;
    const than = valueAround(this.other.ring, tS, this.signal);
    return than === undefined ? undefined : wrapped(value - than, this.signal.wraps);
  }

  private push(tS: number, value: number): void {
    if (this.end === this.tS.length) {
      this.tS.copyWithin(0, this.start, this.end);
      this.values.copyWithin(0, this.start, this.end);
      this.end -= this.start;
      this.start = 0;
    }
    this.tS[this.end] = tS;
    this.values[this.end] = value;
    this.end++;
    if (this.end - this.start > this.feed.ring.capacity) this.start++;
  }

  /** Board time up to which it may be drawn now: it moves smoothly and never beyond the newest row. */
  edgeS(nowS: number): number {
    return this.feed.playhead.at(nowS);
  }

  /** Seconds since a row arrived. */
  quietS(nowMs: number): number {
    return this.feed.ageS(nowMs);
  }

  freeze(): void {
    this.update();
    const { tS, values } = this.live();
    this.frozen = { tS: tS.slice(), values: values.slice() };
  }

  thaw(): void {
    this.frozen = null;
  }

  /** What is drawn and exported: everything held, or as it was when frozen. */
  curve(): Curve {
    return this.frozen ?? this.live();
  }

  private live(): Curve {
    return { tS: this.tS.subarray(this.start, this.end), values: this.values.subarray(this.start, this.end) };
  }

  /** Why there is no data, when the service said so. */
  get refusal(): string {
    return this.feed.refusal;
  }
}

/** Index of the newest time not after tS; −1 when all are later. */
export function indexAt(times: Float64Array, tS: number): number {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const mid = (low + high) >> 1;
    if ((times[mid] ?? Infinity) <= tS) low = mid + 1;
    else high = mid;
  }
  return low - 1;
}
