import type { Trace } from "../../live/trace";
import { csvOf } from "../../logic/csv";
import type { Signal } from "../../logic/signals";
import { quantityName, sourceName } from "../../ui/signalNames";
import { token } from "../../ui/theme.svelte";
import { coloursOf } from "../../ui/chart/colours";
import { drawMark } from "../../ui/chart/draw";
import { timeWindow } from "../../ui/chart/window.svelte";

/** One plot as it stands on the screen. */
export interface Drawn {
  readonly traces: readonly Trace[];
  readonly canvas: HTMLCanvasElement;
  readonly signals: readonly Signal[];
}

const LINE_PX = 24;

function download(blob: Blob, extension: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  const stamp = new Date().toISOString().slice(0, 19).replaceAll(":", "-");
  link.download = `navdeck-${stamp}.${extension}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

interface LegendItem {
  readonly text: string;
  readonly colour: string;
  readonly x: number;
  readonly line: number;
}

/** Place the legend in as many lines as the width needs. */
function legendOf(ctx: CanvasRenderingContext2D, { signals, canvas }: Drawn, scale: number): LegendItem[] {
  const colours = coloursOf(signals);
  let [x, line] = [12 * scale, 0];
  return signals.map((signal, n) => {
    const text = `${quantityName(signal)} (${sourceName(signal)})${signal.unit ? `, ${signal.unit}` : ""}`;
    const width = 30 * scale + ctx.measureText(text).width;
    if (x > 12 * scale && x + width > canvas.width) [x, line] = [12 * scale, line + 1];
    const item = { text, colour: colours[n] ?? "#888", x, line };
    x += width;
    return item;
  });
}

/** Save the plots, one below the other, with their legends. */
export function savePng(plots: readonly Drawn[]): void {
  const scale = devicePixelRatio || 1;
  const linePx = LINE_PX * scale;
  const page = document.createElement("canvas");
  const ctx = page.getContext("2d");
  if (!ctx || plots.length === 0) return;
  const font = `${12 * scale}px ${getComputedStyle(document.body).fontFamily}`;
  ctx.font = font;
  const legends = plots.map((plot) => legendOf(ctx, plot, scale));
  const heads = legends.map((legend) => linePx * (1 + (legend.at(-1)?.line ?? 0)));
  page.width = Math.max(...plots.map((each) => each.canvas.width));
  page.height = plots.reduce((sum, each, n) => sum + each.canvas.height + (heads[n] ?? 0), 0);
  ctx.fillStyle = token("panel");
  ctx.fillRect(0, 0, page.width, page.height);
  ctx.font = font;
  ctx.textBaseline = "middle";
  let y = 0;
  plots.forEach((plot, n) => {
    legends[n]?.forEach((item, k) => drawItem(ctx, item, k, y + (item.line + 0.5) * linePx, scale));
    y += heads[n] ?? 0;
    ctx.drawImage(plot.canvas, 0, y);
    y += plot.canvas.height;
  });
  page.toBlob((blob) => blob && download(blob, "png"));
}

function drawItem(
  ctx: CanvasRenderingContext2D,
  item: LegendItem,
  n: number,
  y: number,
  scale: number,
): void {
  ctx.fillStyle = item.colour;
  drawMark(ctx, n, item.x + 5 * scale, y, 4 * scale);
  ctx.fillStyle = token("text");
  ctx.fillText(item.text, item.x + 14 * scale, y);
}

/** Save the visible stretch of every curve, in the units shown. */
export function saveCsv(plots: readonly Drawn[]): void {
  const traces = new Map(plots.flatMap((each) => each.traces).map((trace) => [trace.signal.id, trace]));
  const columns = [...traces.values()].map((trace) => ({
    name: trace.signal.unit ? `${trace.signal.id} [${trace.signal.unit}]` : trace.signal.id,
    curve: trace.curve(),
  }));
  if (columns.length === 0) return;
  const text = csvOf(columns, timeWindow.toS - timeWindow.spanS, timeWindow.toS);
  download(new Blob([text], { type: "text/csv" }), "csv");
}
