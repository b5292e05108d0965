import { DEG, headingDeg } from "../../logic/angles";
import { DASH } from "../../logic/format";
import { BOX, cells, DIM, font, line, polygon, WHITE, type Frame } from "./frame";

const COMPASS = ["N", "3", "6", "E", "12", "15", "S", "21", "24", "W", "30", "33"] as const;

export function drawHeading(f: Frame): void {
  const { ctx, k, w, h, cx, state } = f;
  const top = h - f.band;
  ctx.save();
  ctx.beginPath();
  ctx.rect(0, top, w, f.band);
  ctx.clip();
  ctx.fillStyle = "#131b23";
  ctx.fillRect(0, top, w, f.band);
  ctx.fillStyle = "rgba(255,255,255,0.28)";
  ctx.fillRect(0, top, w, 1);
  if (Number.isFinite(state.yawRad)) drawHeadingTicks(f, top);
  const half = 31 * k;
  ctx.beginPath();
  const y0 = top + 15 * k;
  polygon(ctx, [
    cx,
    top + 5 * k,
    cx + 7 * k,
    y0,
    cx + half,
    y0,
    cx + half,
    h - 3,
    cx - half,
    h - 3,
    cx - half,
    y0,
    cx - 7 * k,
    y0,
  ]);
  ctx.fillStyle = BOX;
  ctx.fill();
  ctx.strokeStyle = WHITE;
  ctx.lineWidth = 1.4;
  ctx.stroke();
  ctx.fillStyle = WHITE;
  ctx.textBaseline = "middle";
  font(f, 19, 600);
  const y = (y0 + h - 3) / 2 + 1;
  if (!Number.isFinite(state.yawRad)) {
    ctx.textAlign = "center";
    ctx.fillText(DASH, cx, y);
  } else {
    cells(ctx, String(headingDeg(state.yawRad)).padStart(3, "0"), cx + 17 * k, y);
    ctx.textAlign = "left";
    ctx.fillText("°", cx + 18 * k, y);
  }
  ctx.restore();
}

function drawHeadingTicks(f: Frame, top: number): void {
  const { ctx, k, w, cx } = f;
  const yawDeg = f.state.yawRad * DEG;
  const px = (w / 100) * 1.02;
  const reach = w / 2 / px + 12;
  ctx.strokeStyle = DIM;
  ctx.lineWidth = 1.4 * k;
  ctx.textBaseline = "middle";
  ctx.textAlign = "center";
  for (let deg = Math.ceil((yawDeg - reach) / 5) * 5; deg <= yawDeg + reach; deg += 5) {
    const x = cx + (deg - yawDeg) * px;
    const major = deg % 10 === 0;
    line(ctx, x, top, x, top + (major ? 10 : 6) * k);
    if (deg % 30 !== 0 || Math.abs(x - cx) < 42 * k) continue; // the box would cut it
    const name = COMPASS[(((deg / 30) % 12) + 12) % 12] as string;
    const cardinal = /[NESW]/.test(name);
    font(f, cardinal ? 15 : 13, cardinal ? 700 : 500);
    ctx.fillStyle = cardinal ? WHITE : DIM;
    ctx.fillText(name, x, top + 25 * k);
  }
}
