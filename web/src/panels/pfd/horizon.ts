import { clamp, DEG } from "../../logic/angles";
import { BOX, font, line, triangle, WHITE, type Frame } from "./frame";

const SKY = ["#17579a", "#4d9be0"] as const;
const EARTH = ["#8a5a33", "#4f321c"] as const;
const GREY = ["#39454f", "#2b343c"] as const;

function gradient(f: Frame, colours: readonly [string, string], y0: number, y1: number): CanvasGradient {
  const made = f.ctx.createLinearGradient(0, y0, 0, y1);
  made.addColorStop(0, colours[0]);
  made.addColorStop(1, colours[1]);
  return made;
}

export function drawHorizon(f: Frame): void {
  const { ctx, w, h, cx, cy, state } = f;
  ctx.save();
  ctx.beginPath();
  ctx.rect(0, 0, w, h - f.band);
  ctx.clip();
  if (!Number.isFinite(state.rollRad + state.pitchRad)) {
    ctx.fillStyle = gradient(f, GREY, 0, h);
    ctx.fillRect(0, 0, w, h);
  } else {
    const far = Math.hypot(w, h) * 1.5;
    const drop = clamp(state.pitchRad * DEG, -90, 90) * f.pxPerDeg;
    ctx.translate(cx, cy);
    ctx.rotate(-state.rollRad);
    ctx.fillStyle = gradient(f, SKY, drop - h, drop);
    ctx.fillRect(-far, drop - far * 3, 2 * far, far * 3);
    ctx.fillStyle = gradient(f, EARTH, drop, drop + h);
    ctx.fillRect(-far, drop, 2 * far, far * 3);
    ctx.strokeStyle = WHITE;
    ctx.lineWidth = 2 * f.k;
    line(ctx, -far, drop, far, drop);
    drawLadder(f, drop);
  }
  ctx.restore();
}

/** Rungs every 5°, numbered every 10°, clipped to a window round the centre so that they never meet the tapes. */
function drawLadder(f: Frame, drop: number): void {
  const { ctx, k } = f;
  const reach = (f.radius - 14 * k) / f.pxPerDeg;
  const centreDeg = f.state.pitchRad * DEG;
  font(f, 12, 600);
  ctx.textBaseline = "middle";
  ctx.fillStyle = ctx.strokeStyle = WHITE;
  for (let deg = Math.ceil((centreDeg - reach) / 2.5) * 2.5; deg <= centreDeg + reach; deg += 2.5) {
    if (Math.abs(deg) > 90 || deg === 0) continue;
    const y = drop - deg * f.pxPerDeg;
    const nearEdge = clamp((reach - Math.abs(deg - centreDeg)) / 3, 0, 1);
    const half = (deg % 10 === 0 ? 32 : deg % 5 === 0 ? 18 : 8) * k;
    ctx.globalAlpha = 0.95 * nearEdge;
    ctx.lineWidth = (deg % 5 === 0 ? 1.6 : 1.1) * k;
    line(ctx, -half, y, half, y);
    if (deg % 10 !== 0) continue;
    ctx.textAlign = "right";
    ctx.fillText(String(Math.abs(deg)), -half - 5 * k, y);
    ctx.textAlign = "left";
    ctx.fillText(String(Math.abs(deg)), half + 5 * k, y);
  }
  ctx.globalAlpha = 1;
}

const ROLL_TICKS_DEG = [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60] as const;

/** The scale stays with the vehicle, the pointer stays with the sky. */
export function drawRollArc(f: Frame): void {
  const { ctx, cx, cy, k, state, radius } = f;
  if (!Number.isFinite(state.rollRad)) return;
  ctx.save();
  ctx.translate(cx, cy);
  ctx.strokeStyle = ctx.fillStyle = WHITE;
  ctx.lineWidth = 1.6 * k;
  ctx.beginPath();
  ctx.arc(0, 0, radius, -Math.PI / 2 - Math.PI / 3, -Math.PI / 2 + Math.PI / 3);
  ctx.stroke();
  for (const deg of ROLL_TICKS_DEG) {
    const a = (deg - 90) / DEG;
    const outer = radius + (deg % 30 === 0 ? 10 : 6) * k;
    line(ctx, Math.cos(a) * radius, Math.sin(a) * radius, Math.cos(a) * outer, Math.sin(a) * outer);
  }
  ctx.rotate(-clamp(state.rollRad * DEG, -75, 75) / DEG);
  ctx.strokeStyle = BOX;
  ctx.lineWidth = 1;
  triangle(ctx, 0, -radius + 1 * k, 0, -radius + 13 * k, 8 * k, true);
  ctx.restore();
}

/** The vehicle: two wings and a dot, white with a dark edge. */
export function drawSymbol(f: Frame): void {
  const { ctx, cx, cy, k } = f;
  const path = new Path2D();
  for (const side of [-1, 1]) {
    path.moveTo(cx + side * Math.min(88 * k, f.radius - 6 * k), cy);
    path.lineTo(cx + side * 48 * k, cy);
    path.lineTo(cx + side * 48 * k, cy + 10 * k);
  }
  for (const [width, colour] of [
    [7, BOX],
    [3.6, WHITE],
  ] as const) {
    ctx.lineWidth = width * k;
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.lineCap = "square";
    ctx.stroke(path);
    ctx.beginPath();
    ctx.arc(cx, cy, (width === 7 ? 5 : 3.2) * k, 0, 2 * Math.PI);
    ctx.fill();
  }
  ctx.lineCap = "butt";
}
