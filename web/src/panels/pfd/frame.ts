import { clamp } from "../../logic/angles";

/** What the display shows; NaN = unknown, drawn as a dash. */
export interface PfdState {
  rollRad: number;
  pitchRad: number;
  yawRad: number;
  speedMS: number;
  heightM: number;
  climbMS: number;
}

export interface PfdLabels {
  readonly speed: string;
  readonly height: string;
  readonly climb: string;
  readonly font: string;
}

export interface Frame {
  readonly ctx: CanvasRenderingContext2D;
  readonly w: number;
  readonly h: number;
  readonly state: PfdState;
  readonly labels: PfdLabels;
  /** Sizes follow the display: 1 at 376 px. */
  readonly k: number;
  readonly cx: number;
  readonly cy: number;
  readonly pxPerDeg: number;
  readonly tape: number;
  readonly band: number;
  readonly vsi: number;
  /** Of the roll arc. */
  readonly radius: number;
}

export const GLASS = "rgba(8,14,20,0.46)";
export const GLASS_DARK = "rgba(8,14,20,0.72)";
export const BOX = "#0a1117";
export const WHITE = "#ffffff";
export const DIM = "rgba(255,255,255,0.72)";

/** Sizes and places of everything on a display of w × h CSS pixels. */
export function frameOf(
  ctx: CanvasRenderingContext2D,
  w: number,
  h: number,
  state: PfdState,
  labels: PfdLabels,
): Frame {
  const k = clamp(Math.min(w / 376, h / 340), 0.72, 1.7);
  const [band, tape, vsi] = [Math.round(46 * k), Math.round(74 * k), Math.round(30 * k)];
  const inner = w - 2 * tape - vsi;
  return {
    ctx,
    w,
    h,
    state,
    labels,
    k,
    cx: Math.round(tape + inner / 2),
    cy: Math.round((h - band) / 2 + 10 * k),
    pxPerDeg: (h - band) / 46,
    tape,
    band,
    vsi,
    radius: Math.min((h - band) / 2 - 10 * k, inner * 0.5),
  };
}

export function font(f: Frame, size: number, weight = 500): void {
  f.ctx.font = `${weight} ${Math.round(size * f.k)}px ${f.labels.font}`;
}

/** Text in cells of one digit's width, so that nothing jitters whatever the system font; returns the width. */
export function cells(ctx: CanvasRenderingContext2D, text: string, rightX: number, y: number): number {
  const cell = ctx.measureText("0").width;
  ctx.textAlign = "center";
  let x = rightX;
  for (let i = text.length - 1; i >= 0; i--) {
    const char = text[i] as string;
    const wide = char === "." ? cell * 0.5 : cell;
    ctx.fillText(char, x - wide / 2, y);
    x -= wide;
  }
  return rightX - x;
}

export function line(ctx: CanvasRenderingContext2D, x0: number, y0: number, x1: number, y1: number): void {
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}

/** A triangle with its tip at (tipX, tipY) and its base centred at (baseX, baseY), vertical. */
export function triangle(
  ctx: CanvasRenderingContext2D,
  tipX: number,
  tipY: number,
  baseX: number,
  baseY: number,
  half: number,
  outline = false,
): void {
  ctx.beginPath();
  ctx.moveTo(tipX, tipY);
  ctx.lineTo(baseX - half, baseY);
  ctx.lineTo(baseX + half, baseY);
  ctx.closePath();
  ctx.fill();
  if (outline) ctx.stroke();
}

export function polygon(ctx: CanvasRenderingContext2D, points: readonly number[]): void {
  for (let i = 0; i < points.length; i += 2) ctx.lineTo(points[i] as number, points[i + 1] as number);
  ctx.closePath();
}
