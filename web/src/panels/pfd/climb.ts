import { fixed } from "../../logic/format";
import { BOX, cells, DIM, font, GLASS_DARK, line, WHITE, type Frame } from "./frame";

/** Square-root scale: small climbs are readable, 10 m/s still fits. */
function climbOffset(climbMS: number, half: number): number {
  return -Math.sign(climbMS) * Math.sqrt(Math.min(Math.abs(climbMS), 10) / 10) * half;
}

export function drawClimb(f: Frame): void {
  const { ctx, k, cy, state } = f;
  const x = f.w - f.vsi;
  const bottom = f.h - f.band;
  const half = Math.min(cy - 34 * k, bottom - cy - 26 * k);
  ctx.fillStyle = "rgba(8,14,20,0.62)";
  ctx.fillRect(x, 0, f.vsi, bottom);
  ctx.fillStyle = GLASS_DARK;
  ctx.fillRect(x, 0, f.vsi, 24 * k);
  font(f, 11, 600);
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillStyle = WHITE;
  ctx.fillText(f.labels.climb, x + f.vsi / 2, 12.5 * k, f.vsi - 2);
  ctx.strokeStyle = DIM;
  ctx.lineWidth = 1.2 * k;
  font(f, 10, 500);
  ctx.fillStyle = DIM;
  for (const v of [-10, -5, -2, -1, 0, 1, 2, 5, 10]) {
    const y = cy + climbOffset(v, half);
    line(ctx, x, y, x + (v === 0 ? 9 : 5) * k, y);
    ctx.textAlign = "right";
    if (v !== 0) ctx.fillText(String(Math.abs(v)), f.w - 4 * k, y);
  }
  drawClimbValue(f, x, bottom);
  if (Number.isFinite(state.climbMS)) {
    const y = cy + climbOffset(state.climbMS, half);
    ctx.fillStyle = WHITE;
    ctx.fillRect(x + 1, Math.min(y, cy) - 1, 6 * k, Math.abs(y - cy) + 2);
  }
}

function drawClimbValue(f: Frame, x: number, bottom: number): void {
  const { ctx, k, state } = f;
  ctx.fillStyle = BOX;
  ctx.fillRect(x, bottom - 22 * k, f.vsi, 22 * k);
  ctx.fillStyle = WHITE;
  font(f, 11.5, 600);
  const text = Math.abs(state.climbMS) >= 9.95 ? fixed(state.climbMS, 0) : fixed(state.climbMS, 1);
  cells(ctx, text, f.w - 2 * k, bottom - 10.5 * k);
}
