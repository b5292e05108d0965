import { indexAt, type Curve } from "../../live/trace";

/** What of a curve is visible, and where a value lies on the canvas (device pixels). */
export interface Area {
  readonly left: number;
  readonly width: number;
  readonly fromS: number;
  readonly toS: number;
  readonly yOf: (value: number) => number;
}

/** Longest silence still bridged by a line: a few of its own intervals, at least a few of the history's 10 Hz. */
function longestGapS(tS: Float64Array, first: number, last: number): number {
  const mean = last > first ? ((tS[last] ?? 0) - (tS[first] ?? 0)) / (last - first) : 0;
  return Math.max(0.35, mean * 4);
}

export interface Extent {
  readonly low: number;
  readonly high: number;
}

/** Smallest and largest visible value; low above high when there is none. */
export function extentOf({ tS, values }: Curve, fromS: number, toS: number): Extent {
  let low = Infinity;
  let high = -Infinity;
  const last = indexAt(tS, toS);
  for (let i = Math.max(0, indexAt(tS, fromS)); i <= last; i++) {
    const value = values[i] as number;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return { low, high };
}

/**
 * Stroke the visible part: every point while they are few, else first, lowest, highest and last of each pixel column,
 * so that a spike is never lost and the cost is bounded by the width.
 */
export function strokeCurve(
  ctx: CanvasRenderingContext2D,
  { tS, values }: Curve,
  area: Area,
  wraps: number,
): void {
  const first = Math.max(0, indexAt(tS, area.fromS));
  const last = indexAt(tS, area.toS);
  if (last < first) return;
  const gapS = longestGapS(tS, first, last);
  const perS = area.width / (area.toS - area.fromS);
  const thin = last - first > 3 * area.width;
  const column = { x: NaN, low: 0, high: 0, lastX: 0, lastY: 0 };
  /** Finish a pixel column: down to its lowest, up to its highest, on to its last point. */
  const flush = (): void => {
    if (Number.isNaN(column.x)) return;
    if (column.high > column.low) {
      ctx.lineTo(column.x, column.low);
      ctx.lineTo(column.x, column.high);
    }
    ctx.lineTo(column.lastX, column.lastY);
    column.x = NaN;
  };
  let [beforeS, before] = [-Infinity, NaN];
  ctx.beginPath();
  for (let i = first; i <= last; i++) {
    const [t, value] = [tS[i] as number, values[i] as number];
    if (Number.isNaN(value)) continue; // a row that does not know: only a stretch of them is a gap
    const x = area.left + (t - area.fromS) * perS;
    const y = area.yOf(value);
    if (t - beforeS > gapS || (wraps > 0 && Math.abs(value - before) > wraps / 2)) {
      flush();
      ctx.moveTo(x, y);
    }
    [beforeS, before] = [t, value];
    if (!thin) {
      ctx.lineTo(x, y);
      continue;
    }
    if (Math.round(x) !== column.x) {
      flush();
      ctx.lineTo(x, y);
      column.x = Math.round(x);
      column.low = column.high = y;
    }
    column.low = Math.min(column.low, y);
    column.high = Math.max(column.high, y);
    column.lastX = x;
    column.lastY = y;
  }
  flush();
  ctx.stroke();
}

/** A row that does not know the value leaves the one before it standing for this long. */
const STANDS_S = 0.5;

/** Index of the newest known value at tS; −1 when there is none near. */
export function knownAt({ tS, values }: Curve, t: number): number {
  let i = indexAt(tS, t);
  const newestS = tS[i] ?? NaN;
  while (i >= 0 && Number.isNaN(values[i]) && newestS - (tS[i] ?? NaN) < STANDS_S) i--;
  return i >= 0 && !Number.isNaN(values[i]) ? i : -1;
}

/** The mark of the n-th curve of a plot: a shape beside the colour, the same in the legend. */
export function drawMark(ctx: CanvasRenderingContext2D, n: number, x: number, y: number, r: number): void {
  ctx.beginPath();
  const kind = n % 4;
  if (kind === 0) ctx.arc(x, y, r, 0, 2 * Math.PI);
  else if (kind === 1) ctx.rect(x - r * 0.9, y - r * 0.9, r * 1.8, r * 1.8);
  else if (kind === 2) {
    ctx.moveTo(x, y - r * 1.2);
    ctx.lineTo(x + r * 1.1, y + r * 0.8);
    ctx.lineTo(x - r * 1.1, y + r * 0.8);
  } else {
    ctx.moveTo(x, y - r * 1.3);
    ctx.lineTo(x + r * 1.3, y);
    ctx.lineTo(x, y + r * 1.3);
    ctx.lineTo(x - r * 1.3, y);
  }
  ctx.closePath();
  ctx.fill();
}
