import type { Curve, Trace } from "../../live/trace";
import { indexAt } from "../../live/trace";
import type { Backdrop } from "./chart";
import type { Area, Extent } from "./draw";

/** What an innovation is judged by: a band of one σ about zero, a line `gate` σ off on either side, refused ones. */
export interface Bound {
  readonly sigma: Trace;
  readonly refused: Trace;
  readonly gate: number;
  readonly bandColour: string;
  readonly gateColour: string;
  readonly refusedColour: string;
}

/** Largest visible σ; NaN when there is none. */
function largest({ tS, values }: Curve, fromS: number, toS: number): number {
  let most = NaN;
  const last = indexAt(tS, toS);
  for (let i = Math.max(0, indexAt(tS, fromS)); i <= last; i++) {
    const value = values[i] as number;
    if (!(value <= most) && Number.isFinite(value)) most = value;
  }
  return most;
}

/** Points of the upper edge k σ above zero; a silence ends nothing: the σ is told with each measurement. */
function edge({ tS, values }: Curve, area: Area, k: number): [x: number, y: number][] {
  const points: [number, number][] = [];
  const perS = area.width / (area.toS - area.fromS);
  const last = indexAt(tS, area.toS);
  for (let i = Math.max(0, indexAt(tS, area.fromS)); i <= last; i++) {
    const value = values[i] as number;
    if (!Number.isFinite(value)) continue;
    points.push([area.left + ((tS[i] as number) - area.fromS) * perS, k * value]);
  }
  return points;
}

function outline(
  ctx: CanvasRenderingContext2D,
  points: readonly (readonly [number, number])[],
  yOf: Area["yOf"],
): void {
  points.forEach(([x, y], i) => (i ? ctx.lineTo(x, yOf(y)) : ctx.moveTo(x, yOf(y))));
}

/** The bound of an innovation as what lies behind its curve. */
export function boundBackdrop(bound: Bound): Backdrop {
  const { sigma, refused, gate } = bound;
  const scale = devicePixelRatio || 1;
  return {
    traces: [sigma, refused],
    extent: (fromS, toS): Extent => {
      const most = gate * largest(sigma.curve(), fromS, toS);
      return Number.isNaN(most) ? { low: Infinity, high: -Infinity } : { low: -most, high: most };
    },
    draw: (ctx, area) => {
      const band = edge(sigma.curve(), area, 1);
      const mirrored = [...band].reverse().map(([x, y]) => [x, -y] as const);
      ctx.fillStyle = bound.bandColour;
      ctx.beginPath();
      outline(ctx, [...band, ...mirrored], area.yOf);
      ctx.fill();
      ctx.strokeStyle = bound.gateColour;
      ctx.lineWidth = scale;
      ctx.setLineDash([4 * scale, 3 * scale]);
      for (const k of [gate, -gate]) {
        ctx.beginPath();
        outline(ctx, edge(sigma.curve(), area, k), area.yOf);
        ctx.stroke();
      }
      ctx.setLineDash([]);
      crosses(ctx, refused.curve(), area, bound.refusedColour, scale);
    },
  };
}

/** Mark what was refused for being too large: a shape, not a colour alone. */
function crosses(
  ctx: CanvasRenderingContext2D,
  curve: Curve,
  area: Area,
  colour: string,
  scale: number,
): void {
  const r = 4 * scale;
  ctx.strokeStyle = colour;
  ctx.lineWidth = 2 * scale;
  ctx.beginPath();
  const perS = area.width / (area.toS - area.fromS);
  const last = indexAt(curve.tS, area.toS);
  for (let i = Math.max(0, indexAt(curve.tS, area.fromS)); i <= last; i++) {
    const value = curve.values[i] as number;
    if (Number.isNaN(value)) continue;
    const [x, y] = [area.left + ((curve.tS[i] as number) - area.fromS) * perS, area.yOf(value)];
    ctx.moveTo(x - r, y - r);
    ctx.lineTo(x + r, y + r);
    ctx.moveTo(x + r, y - r);
    ctx.lineTo(x - r, y + r);
  }
  ctx.stroke();
}
