import type { Rows } from "./rows";

/** History comes at 10 Hz: a row of it is used only where no row of the stream is held this near. */
const FILL_GAP_S = 0.09;

/** A row that comes this late still finds its place: messages of one board are stamped each by its own sender. */
export const LATE_S = 0.5;

/**
 * The newest `capacity` rows of one topic, a typed array per column, memory fixed at construction.
 *
 * Arrays are twice as long as the capacity: rows are appended until the end is reached, then the newest half is moved
 * to the front, so that `window` is always one contiguous, ascending view without a copy.
 */
export class Ring {
  readonly columns: readonly string[];
  readonly capacity: number;
  private readonly tS: Float64Array;
  private readonly values: Float64Array[];
  private readonly indexByName: Map<string, number>;
  private start = 0;
  private end = 0;
  private boot = -1;
  /** Counts changes, so that who draws can see that nothing is new. */
  version = 0;
  /** Counts the times when what was held before is no longer a part of what is held now. */
  epoch = 0;
  /** Counts the rows of the last `LATE_S` that were put between others or learned another column. */
  revision = 0;

  constructor(columns: readonly string[], capacity: number) {
    this.columns = columns;
    this.capacity = capacity;
    this.tS = new Float64Array(2 * capacity);
    this.values = columns.map(() => new Float64Array(2 * capacity));
    this.indexByName = new Map(columns.map((name, i) => [name, i]));
  }

  get length(): number {
    return this.end - this.start;
  }

  get bootId(): number {
    return this.boot;
  }

  /** Board time of the newest row, s; NaN before the first. */
  get newestS(): number {
    return this.length > 0 ? (this.tS[this.end - 1] ?? NaN) : NaN;
  }

  get oldestS(): number {
    return this.length > 0 ? (this.tS[this.start] ?? NaN) : NaN;
  }

  clear(): void {
    this.start = this.end = 0;
    this.version++;
    this.epoch++;
  }

  /**
   * Append rows. A new power-up forgets the old one, also when only the time says so (a restarted service counts power-ups
   * afresh). Rows of one moment become one, which knows what either knew; a late row is put in its place.
   */
  append(rows: Rows): void {
    if (rows.nCols !== this.columns.length || rows.nRows === 0) return;
    const lastS = (rows.tNs[rows.nRows - 1] ?? NaN) * 1e-9;
    if (rows.bootId !== this.boot || lastS < this.newestS - 1) {
      this.clear();
      this.boot = rows.bootId;
    }
    for (let row = 0; row < rows.nRows; row++)
      this.push((rows.tNs[row] ?? NaN) * 1e-9, rows.data, row * rows.nCols);
    this.version++;
  }

  /** Put a history answer into the stretches for which nothing is held; keeps the newest `capacity`. */
  fill(rows: Rows): void {
    if (rows.nCols !== this.columns.length || rows.nRows === 0) return;
    if (this.boot >= 0 && rows.bootId !== this.boot) return;
    const kept = this.copyOut();
    this.clear();
    this.boot = rows.bootId;
    const line = new Float64Array(this.columns.length);
    let [k, keptS] = [0, -Infinity];
    const takeUntil = (limitS: number): void => {
      for (; k < kept.tS.length && (kept.tS[k] ?? NaN) <= limitS; k++) {
        kept.values.forEach((column, c) => (line[c] = column[k] ?? NaN));
        keptS = kept.tS[k] ?? NaN;
        this.push(keptS, line, 0);
      }
    };
    for (let row = 0; row < rows.nRows; row++) {
      const tS = (rows.tNs[row] ?? NaN) * 1e-9;
      takeUntil(tS + FILL_GAP_S);
      if (tS - keptS >= FILL_GAP_S) this.push(tS, rows.data, row * rows.nCols);
    }
    takeUntil(Infinity);
    this.version++;
  }

  private copyOut(): { tS: Float64Array; values: Float64Array[] } {
    return {
      tS: this.tS.slice(this.start, this.end),
      values: this.values.map((column) => column.slice(this.start, this.end)),
    };
  }

  private push(tS: number, data: Float64Array, offset: number): void {
    const lastS = this.newestS;
    if (tS <= lastS) {
      if (lastS - tS <= LATE_S) this.amend(tS, data, offset);
    } else if (!Number.isNaN(tS)) this.insert(this.length, tS, data, offset);
  }

  /** Take a row that is not newer than all: into the one of the same moment, else between its neighbours. */
  private amend(tS: number, data: Float64Array, offset: number): void {
    const before = this.indexAt(tS);
    const at = this.start + before;
    if (before < 0 || this.tS[at] !== tS) this.insert(before + 1, tS, data, offset);
    else if (!this.values.some((column, k) => Number.isNaN(column[at]) && !Number.isNaN(data[offset + k])))
      return;
    else
      this.values.forEach((column, k) => {
        if (Number.isNaN(column[at])) column[at] = data[offset + k] ?? NaN;
      });
    this.revision++;
  }

  private insert(index: number, tS: number, data: Float64Array, offset: number): void {
    if (this.end === this.tS.length) this.compact();
    const at = this.start + index;
    for (const column of [this.tS, ...this.values]) column.copyWithin(at + 1, at, this.end);
    this.tS[at] = tS;
    for (let k = 0; k < this.values.length; k++)
      (this.values[k] as Float64Array)[at] = data[offset + k] ?? NaN;
    this.end++;
    if (this.end - this.start > this.capacity) this.start = this.end - this.capacity;
  }

  private compact(): void {
    this.tS.copyWithin(0, this.start, this.end);
    for (const column of this.values) column.copyWithin(0, this.start, this.end);
    this.end -= this.start;
    this.start = 0;
  }

  index(name: string): number {
    return this.indexByName.get(name) ?? -1;
  }

  /** All times held, s, ascending: a view, valid until the next append. */
  times(): Float64Array {
    return this.tS.subarray(this.start, this.end);
  }

  /** All values held of one column: a view beside `times`. */
  column(index: number): Float64Array {
    return (this.values[index] ?? new Float64Array(0)).subarray(this.start, this.end);
  }

  /** Index (within `times`) of the newest row not after tS, -1 when all are later. */
  indexAt(tS: number): number {
    let low = this.start;
    let high = this.end;
    while (low < high) {
      const mid = (low + high) >> 1;
      if ((this.tS[mid] ?? Infinity) <= tS) low = mid + 1;
      else high = mid;
    }
    return low - 1 - this.start;
  }

  /** Value by column name of the row at `index` within `times`; NaN when unknown. */
  value(index: number, name: string): number {
    const k = this.index(name);
    if (k < 0 || index < 0 || index >= this.length) return NaN;
    return this.values[k]?.[this.start + index] ?? NaN;
  }

  /** Newest value of a column; NaN when unknown. */
  newest(name: string): number {
    return this.value(this.length - 1, name);
  }
}
