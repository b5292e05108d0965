import type { Trace } from "../../live/trace";
import { csvOf } from "../../logic/csv";
import { fileStem, wireTitle } from "../../logic/files";
import { token } from "../theme.svelte";
import type { Chart } from "./chart";
import { drawMark } from "./draw";
import { timeWindow } from "./window.svelte";

/** What stands beside a text of the legend: by default the mark of the curve of that place. */
export interface LegendEntry {
  readonly text: string;
  readonly colour: string;
  /** Dash pattern of a line, px. */
  readonly dash?: readonly number[];
  readonly band?: boolean;
}

/** One plot as it stands on the screen. */
export interface Drawn {
  /** "" where the legend says everything. */
  readonly title: string;
  readonly legend: readonly LegendEntry[];
  readonly traces: readonly Trace[];
  readonly chart: Chart;
}

const LINE_PX = 24;
const LEFT_PX = 12;
const SIGN_PX = 22;

function download(blob: Blob, plots: readonly Drawn[], extension: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  const stem = plots.length === 1 ? fileStem(plots[0]?.traces[0]?.signal) : "";
  const stamp = new Date().toISOString().slice(0, 19).replaceAll(":", "-");
  link.download = `${["navdeck", stem, stamp].filter(Boolean).join("-")}.${extension}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

interface Placed extends LegendEntry {
  readonly x: number;
  readonly line: number;
}

/** Place the legend in as many lines as the width needs, below the title. */
function placed(ctx: CanvasRenderingContext2D, { title, legend, chart }: Drawn, scale: number): Placed[] {
  const left = LEFT_PX * scale;
  let [x, line] = [left, title ? 1 : 0];
  return legend.map((entry) => {
    const width = (SIGN_PX + LEFT_PX) * scale + ctx.measureText(entry.text).width;
    if (x > left && x + width > chart.canvas.width) [x, line] = [left, line + 1];
    const item = { ...entry, x, line };
    x += width;
    return item;
  });
}

/** Save the plots, one below the other, with their titles and legends. */
export async function savePng(plots: readonly Drawn[]): Promise<void> {
  for (const { chart } of plots) chart.redraw();
  await new Promise((done) => setTimeout(done));
  const scale = devicePixelRatio || 1;
  const linePx = LINE_PX * scale;
  const page = document.createElement("canvas");
  const ctx = page.getContext("2d");
  if (!ctx || plots.length === 0) return;
  const font = `${12 * scale}px ${getComputedStyle(document.body).fontFamily}`;
  ctx.font = font;
  const legends = plots.map((plot) => placed(ctx, plot, scale));
  const heads = legends.map((legend) => linePx * (1 + (legend.at(-1)?.line ?? 0)));
  page.width = Math.max(...plots.map((each) => each.chart.canvas.width));
  page.height = plots.reduce((sum, each, n) => sum + each.chart.canvas.height + (heads[n] ?? 0), 0);
  ctx.fillStyle = token("panel");
  ctx.fillRect(0, 0, page.width, page.height);
  ctx.textBaseline = "middle";
  let y = 0;
  plots.forEach((plot, n) => {
    ctx.font = `bold ${font}`;
    ctx.fillStyle = token("text");
    ctx.fillText(plot.title, LEFT_PX * scale, y + linePx / 2);
    ctx.font = font;
    legends[n]?.forEach((item, k) => drawItem(ctx, item, k, y + (item.line + 0.5) * linePx, scale));
    y += heads[n] ?? 0;
    ctx.drawImage(plot.chart.canvas, 0, y);
    y += plot.chart.canvas.height;
  });
  page.toBlob((blob) => blob && download(blob, plots, "png"));
}

function drawItem(ctx: CanvasRenderingContext2D, item: Placed, n: number, y: number, scale: number): void {
  const middle = item.x + (SIGN_PX * scale) / 2 - 3 * scale;
  ctx.fillStyle = ctx.strokeStyle = item.colour;
  if (item.band) ctx.fillRect(item.x, y - 5 * scale, 16 * scale, 10 * scale);
  else if (item.dash?.length) {
    ctx.lineWidth = 2 * scale;
    ctx.setLineDash(item.dash.map((each) => each * scale));
    ctx.beginPath();
    ctx.moveTo(item.x, y);
    ctx.lineTo(item.x + 18 * scale, y);
    ctx.stroke();
    ctx.setLineDash([]);
  } else drawMark(ctx, n, middle, y, 4 * scale);
  ctx.fillStyle = token("text");
  ctx.fillText(item.text, item.x + SIGN_PX * scale, y);
}

/** Save the visible stretch of every curve, in the units shown. */
export function saveCsv(plots: readonly Drawn[]): void {
  const traces = new Map(plots.flatMap((each) => each.traces).map((trace) => [trace.signal.id, trace]));
  if (traces.size === 0) return;
  const columns = [...traces.values()].map((trace) => {
    trace.update(); // out of sight nobody does
    return { name: wireTitle(trace.signal), curve: trace.curve() };
  });
  const text = csvOf(columns, timeWindow.toS - timeWindow.spanS, timeWindow.toS);
  download(new Blob([text], { type: "text/csv" }), plots, "csv");
}
