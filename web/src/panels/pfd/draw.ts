import { drawClimb } from "./climb";
import { frameOf, type PfdLabels, type PfdState } from "./frame";
import { drawHeading } from "./heading";
import { drawHorizon, drawRollArc, drawSymbol } from "./horizon";
import { drawHeight, drawSpeed } from "./tapes";

/** Draw everything into a w × h area (CSS pixels; the context carries the device scale). */
export function drawPfd(
  ctx: CanvasRenderingContext2D,
  w: number,
  h: number,
  state: PfdState,
  labels: PfdLabels,
): void {
  const frame = frameOf(ctx, w, h, state, labels);
  ctx.lineCap = "butt";
  ctx.lineJoin = "round";
  drawHorizon(frame);
  drawRollArc(frame);
  drawSymbol(frame);
  drawSpeed(frame);
  drawHeight(frame);
  drawClimb(frame);
  drawHeading(frame);
}
