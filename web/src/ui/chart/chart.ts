import uPlot from "uplot";
import { onFrame } from "../../live/frames";
import { indexAt, type Trace } from "../../live/trace";
import { clock, DASH, decimalsFor, fixed } from "../../logic/format";
import { steadyRange, type Range } from "../../logic/range";
import { token } from "../theme.svelte";
import { drawMark, extentOf, knownAt, strokeCurve, type Area, type Extent } from "./draw";
import { watchEdge } from "./edge";
import { gestures } from "./gestures";
import { timeWindow } from "./window.svelte";

const SYNC = "navdeck";
/** Plots move thirty times a second; the display beside them sixty. */
const FRAME_MS = 30;
/** A value further than this from the cursor is not its value. */
const NEAR_S = 5;

/** How curves look, in their order. */
export interface Look {
  readonly colours: readonly string[];
  /** Dash patterns, px; missing or empty = solid. */
  readonly dashes?: readonly (readonly number[])[];
}

/** What is drawn behind the curves, from traces of its own. */
export interface Backdrop {
  readonly traces: readonly Trace[];
  extent: (fromS: number, toS: number) => Extent;
  draw: (ctx: CanvasRenderingContext2D, area: Area) => void;
}

/** Axes, cursor and gestures by uPlot; the curves are stroked here, straight from the traces. */
export class Chart {
  private readonly plot: uPlot;
  private readonly traces: readonly Trace[];
  private readonly look: Look;
  private readonly backdrop: Backdrop | undefined;
  private readonly say: (n: number, text: string) => void;
  private readonly stops: readonly (() => void)[];
  private range: Range | null = null;
  private inView = true;
  private drawnMs = -Infinity;
  private drawnKey = "";

  /** `say` gets the n-th value under the cursor, or the newest, as text. */
  constructor(
    host: HTMLElement,
    size: { readonly width: number; readonly height: number },
    traces: readonly Trace[],
    look: Look,
    say: (n: number, text: string) => void,
    backdrop?: Backdrop,
  ) {
    this.traces = traces;
    this.look = look;
    this.say = say;
    this.backdrop = backdrop;
    const noData: uPlot.AlignedData = [
      [0, 1],
      [null, null],
    ];
    this.plot = new uPlot(this.options(size), noData, host);
    const watcher = new IntersectionObserver(
      (entries) => (this.inView = entries.at(-1)?.isIntersecting ?? true),
    );
    watcher.observe(host);
    this.stops = [
      gestures(this.plot.over, () => this.plot.posToVal(this.plot.cursor.left ?? 0, "x")),
      onFrame((nowMs) => this.frame(nowMs)),
      watchEdge(traces),
      () => watcher.disconnect(),
      () => this.plot.destroy(),
    ];
  }

  get canvas(): HTMLCanvasElement {
    return this.plot.ctx.canvas;
  }

  /** Take another size; what is shown stays. */
  resize(width: number, height: number): void {
    if (this.plot.width === width && this.plot.height === height) return;
    this.plot.setSize({ width, height });
    this.drawnKey = "";
  }

  destroy(): void {
    for (const stop of this.stops) stop();
  }

  private options(size: { readonly width: number; readonly height: number }): uPlot.Options {
    const grid = { stroke: token("line"), width: 1 };
    const font = `11px ${getComputedStyle(document.body).fontFamily}`;
    const axis = { stroke: token("text-2"), grid, ticks: { show: false }, font, labelFont: font, gap: 4 };
    const times: uPlot.Axis.DynamicValues = (_, ticks, _axis, _space, step) =>
      ticks.map((tick) => clock(tick, step < 1 ? 1 : 0));
    return {
      ...size,
      padding: [8, 12, 0, 0],
      legend: { show: false },
      cursor: {
        points: { show: false },
        drag: { x: false, y: false, setScale: false },
        y: false,
        sync: { key: SYNC, scales: ["x", null] },
      },
      scales: {
        x: { time: false },
        y: { range: () => (this.range ? [this.range.min, this.range.max] : [0, 1]) },
      },
      series: [{}, { show: true, scale: "y", paths: () => null, points: { show: false } }],
      axes: [
        { ...axis, size: 24, space: 70, values: times },
        { ...axis, size: 52, space: 20, values: (_, ticks) => ticks.map(axisNumber) },
      ],
      hooks: { draw: [(plot) => this.drawCurves(plot)] },
    };
  }

  /** While something moves: shift the window, fit the axis, write the numbers. */
  private frame(nowMs: number): void {
    if (nowMs - this.drawnMs >= FRAME_MS && this.inView) this.redraw(nowMs);
  }

  /** Show what there is now, also out of sight: for who takes the canvas, which is drawn when this task is over. */
  redraw(nowMs = performance.now()): void {
    const { toS, spanS } = timeWindow;
    const key = `${toS} ${spanS} ${this.plot.cursor.left}`;
    if (!Number.isFinite(toS) || key === this.drawnKey) return;
    [this.drawnMs, this.drawnKey] = [nowMs, key];
    this.fit(toS - spanS, toS);
    this.plot.setScale("x", { min: toS - spanS, max: toS });
    this.readOut(toS);
  }

  private fit(fromS: number, toS: number): void {
    let [low, high] = [Infinity, -Infinity];
    for (const trace of this.traces) {
      trace.update();
      const extent = extentOf(trace.curve(), fromS, toS);
      low = Math.min(low, extent.low);
      high = Math.max(high, extent.high);
    }
    if (this.backdrop) {
      for (const trace of this.backdrop.traces) trace.update();
      const extent = this.backdrop.extent(fromS, toS);
      [low, high] = [Math.min(low, extent.low), Math.max(high, extent.high)];
    }
    const least = Math.max(1e-4, Math.abs(high + low) * 1e-3);
    this.range = steadyRange(this.range, low, high, Number.isFinite(least) ? least : 1);
  }

  private readOut(toS: number): void {
    const left = this.plot.cursor.left ?? -1;
    const atS = left >= 0 ? this.plot.posToVal(left, "x") : toS;
    const decimals = decimalsFor(this.range ? this.range.max - this.range.min : NaN);
    this.traces.forEach((trace, n) => {
      const { tS, values } = trace.curve();
      const i = knownAt({ tS, values }, atS);
      const known = i >= 0 && atS - (tS[i] ?? 0) < NEAR_S;
      this.say(n, known ? fixed(values[i], decimals) : DASH);
    });
  }

  /** The first curve ends up on top. */
  private drawCurves({ ctx, bbox, scales, valToPos }: uPlot): void {
    const [fromS, toS] = [scales["x"]?.min ?? 0, scales["x"]?.max ?? 1];
    const scale = devicePixelRatio || 1;
    const yOf = (value: number): number => valToPos(value, "y", true);
    const area = { left: bbox.left, width: bbox.width, fromS, toS, yOf };
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width + 8 * scale, bbox.height);
    ctx.clip();
    this.backdrop?.draw(ctx, area);
    ctx.lineJoin = "round";
    ctx.lineWidth = 1.5 * scale;
    for (let n = this.traces.length - 1; n >= 0; n--) {
      const trace = this.traces[n] as Trace;
      ctx.strokeStyle = ctx.fillStyle = this.look.colours[n] ?? "#888";
      const { tS, values } = trace.curve();
      dashed(ctx, this.look.dashes?.[n] ?? [], scale, tS[Math.max(0, indexAt(tS, fromS))] ?? 0, area);
      strokeCurve(ctx, { tS, values }, area, trace.signal.wraps);
      ctx.setLineDash([]);
      const i = knownAt({ tS, values }, toS);
      const [endS, end] = [tS[i] ?? NaN, values[i] ?? NaN];
      if (!(endS >= fromS) || !Number.isFinite(end)) continue;
      drawMark(ctx, n, bbox.left + ((endS - fromS) / (toS - fromS)) * bbox.width, yOf(end), 3 * scale);
    }
    ctx.restore();
  }
}

/** Set a dash pattern that moves with the data: its phase follows the time of the first point, not the window. */
function dashed(
  ctx: CanvasRenderingContext2D,
  pattern: readonly number[],
  scale: number,
  firstS: number,
  { width, fromS, toS }: Area,
): void {
  if (pattern.length === 0) return;
  const pixels = pattern.map((each) => each * scale);
  ctx.setLineDash(pixels);
  const period = pixels.reduce((sum, each) => sum + each, 0);
  ctx.lineDashOffset = ((firstS * width) / (toS - fromS)) % period;
}

function axisNumber(value: number): string {
  return String(Number(value.toPrecision(6))).replace("-", "\u2212");
}
