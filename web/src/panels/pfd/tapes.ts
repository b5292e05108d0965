import { DASH, fixed } from "../../logic/format";
import { BOX, cells, DIM, font, GLASS, GLASS_DARK, line, polygon, WHITE, type Frame } from "./frame";

interface Tape {
  readonly x: number;
  readonly width: number;
  readonly value: number;
  readonly decimals: number;
  readonly label: string;
  readonly unit: string;
  /** Side on which the ticks and the notch are: towards the horizon. */
  readonly inner: "left" | "right";
  readonly minimum: number;
}

export function drawSpeed(f: Frame): void {
  const value = f.state.speedMS;
  drawTape(f, {
    x: 0,
    width: f.tape,
    value,
    decimals: 1,
    label: f.labels.speed,
    unit: "m/s",
    inner: "right",
    minimum: 0,
  });
}

export function drawHeight(f: Frame): void {
  const x = f.w - f.tape - f.vsi;
  const tape = { x, width: f.tape, value: f.state.heightM, decimals: 1, label: f.labels.height, unit: "m" };
  drawTape(f, { ...tape, inner: "left", minimum: -Infinity });
}

/** Units between two ticks so that about ten are visible for every size of value. */
function tickStep(value: number): number {
  const size = Math.abs(value);
  return size >= 1000 ? 10 : size >= 200 ? 5 : 1;
}

function drawTape(f: Frame, tape: Tape): void {
  const { ctx, k, cy } = f;
  const bottom = f.h - f.band;
  ctx.save();
  ctx.beginPath();
  ctx.rect(tape.x, 0, tape.width, bottom);
  ctx.clip();
  ctx.fillStyle = GLASS;
  ctx.fillRect(tape.x, 0, tape.width, bottom);
  const caption = 24 * k;
  ctx.save();
  ctx.beginPath();
  ctx.rect(tape.x, caption, tape.width, bottom - caption);
  ctx.clip();
  if (Number.isFinite(tape.value)) drawTicks(f, tape);
  ctx.restore();
  ctx.fillStyle = GLASS_DARK;
  ctx.fillRect(tape.x, 0, tape.width, caption);
  font(f, 11, 600);
  ctx.textBaseline = "middle";
  ctx.textAlign = "left";
  ctx.fillStyle = WHITE;
  ctx.fillText(tape.label, tape.x + 6 * k, 12.5 * k, tape.width - 30 * k);
  ctx.textAlign = "right";
  ctx.fillStyle = DIM;
  font(f, 11, 400);
  ctx.fillText(tape.unit, tape.x + tape.width - 6 * k, 12.5 * k);
  ctx.restore();
  drawTapeBox(f, tape, cy);
}

function drawTicks(f: Frame, tape: Tape): void {
  const { ctx, k, cy } = f;
  const step = tickStep(tape.value);
  const px = (18 * k) / step;
  const reach = (f.h - f.band) / 2 / px + step;
  const edge = tape.inner === "right" ? tape.x + tape.width : tape.x;
  const inward = tape.inner === "right" ? -1 : 1;
  font(f, 12.5, 500);
  ctx.textBaseline = "middle";
  ctx.strokeStyle = DIM;
  ctx.fillStyle = "rgba(255,255,255,0.9)";
  ctx.lineWidth = 1.4 * k;
  for (let v = Math.ceil((tape.value - reach) / step) * step; v <= tape.value + reach; v += step) {
    if (v < tape.minimum) continue;
    const y = cy - (v - tape.value) * px;
    const major = Math.round(v / step) % 5 === 0;
    line(ctx, edge, y, edge + inward * (major ? 11 : 6) * k, y);
    if (!major) continue;
    if (tape.inner === "right") cells(ctx, fixed(v, 0), edge - 17 * k, y + 0.5);
    else cells(ctx, fixed(v, 0), tape.x + tape.width - 8 * k, y + 0.5);
  }
}

/** The present value: dark box with a notch towards the horizon. */
function drawTapeBox(f: Frame, tape: Tape, cy: number): void {
  const { ctx, k } = f;
  const half = 17 * k;
  const notch = 8 * k;
  const x0 = tape.x + 2;
  const x1 = tape.x + tape.width - 2;
  ctx.beginPath();
  if (tape.inner === "right") {
    polygon(ctx, [
      x0,
      cy - half,
      x1,
      cy - half,
      x1,
      cy - notch,
      x1 + notch,
      cy,
      x1,
      cy + notch,
      x1,
      cy + half,
      x0,
      cy + half,
    ]);
  } else {
    polygon(ctx, [
      x0,
      cy - half,
      x1,
      cy - half,
      x1,
      cy + half,
      x0,
      cy + half,
      x0,
      cy + notch,
      x0 - notch,
      cy,
      x0,
      cy - notch,
    ]);
  }
  ctx.fillStyle = BOX;
  ctx.fill();
  ctx.strokeStyle = WHITE;
  ctx.lineWidth = 1.4;
  ctx.stroke();
  ctx.fillStyle = WHITE;
  ctx.textBaseline = "middle";
  const text = Math.abs(tape.value) >= 999.95 ? fixed(tape.value, 0) : fixed(tape.value, tape.decimals);
  font(f, 21, 600);
  if (text === DASH) {
    ctx.textAlign = "center";
    ctx.fillText(DASH, (x0 + x1) / 2, cy + 1);
  } else cells(ctx, text, x1 - 6 * k, cy + 1);
}
