import { describe, expect, it } from "vitest";
import { extentOf, knownAt, strokeCurve } from "../src/ui/chart/draw";

/** Records what a canvas would be told. */
function recorder(): { ctx: CanvasRenderingContext2D; strokes: () => [number, number][][] } {
  const strokes: [number, number][][] = [];
  const ctx = {
    beginPath: () => undefined,
    stroke: () => undefined,
    moveTo: (x: number, y: number) => strokes.push([[x, y]]),
    lineTo: (x: number, y: number) => strokes.at(-1)?.push([x, y]),
  };
  return { ctx: ctx as unknown as CanvasRenderingContext2D, strokes: () => strokes };
}

function curve(values: readonly number[], stepS = 0.1): { tS: Float64Array; values: Float64Array } {
  return { tS: Float64Array.from(values, (_, i) => i * stepS), values: Float64Array.from(values) };
}

const area = (toS: number, width = 1000) => ({
  left: 0,
  width,
  fromS: 0,
  toS,
  yOf: (value: number) => value,
});

describe("strokeCurve", () => {
  it("breaks the line at a stretch of unknown values and at a long silence", () => {
    const { ctx, strokes } = recorder();
    const broken = curve([0, 1, NaN, NaN, NaN, NaN, NaN, 3, 4]);
    strokeCurve(ctx, broken, area(1), 0);
    expect(strokes().length).toBe(2);
    const tS = Float64Array.from({ length: 40 }, (_, i) => i * 0.1 + (i < 20 ? 0 : 3));
    const second = recorder();
    strokeCurve(second.ctx, { tS, values: tS }, area(10), 0);
    expect(second.strokes().length).toBe(2);
  });

  it("bridges single rows that do not know, as of a lane whose messages alternate", () => {
    const { ctx, strokes } = recorder();
    const alternating = curve([0, NaN, 2, NaN, 4]);
    strokeCurve(ctx, alternating, area(1), 0);
    expect(strokes().length).toBe(1);
    expect(knownAt(alternating, 0.35)).toBe(2);
    expect(knownAt(curve([1, NaN, NaN, NaN, NaN, NaN, NaN, NaN]), 0.7)).toBe(-1);
  });

  it("does not draw across the jump of a heading from 359 to 1", () => {
    const { ctx, strokes } = recorder();
    strokeCurve(ctx, curve([357, 359, 1, 3]), area(1), 360);
    expect(strokes().length).toBe(2);
  });

  it("keeps a single spike among ten thousand points", () => {
    const values = Array.from({ length: 10_000 }, (_, i) => (i === 5003 ? 99 : 0));
    const { ctx, strokes } = recorder();
    strokeCurve(ctx, curve(values, 0.001), area(10, 100), 0);
    const points = strokes().flat();
    expect(Math.max(...points.map(([, y]) => y))).toBe(99);
    expect(points.length).toBeLessThan(600);
  });

  it("leaves no holes between the columns of a thinned line", () => {
    const values = Array.from({ length: 10_000 }, (_, i) => Math.sin(i / 300));
    const { ctx, strokes } = recorder();
    strokeCurve(ctx, curve(values, 0.001), area(10, 100), 0);
    expect(strokes().length).toBe(1);
    const xs = (strokes()[0] ?? []).map(([x]) => x);
    const steps = xs.slice(1).map((x, i) => x - (xs[i] ?? 0));
    expect(Math.max(...steps)).toBeLessThan(1.1);
  });
});

describe("extentOf", () => {
  it("sees only what is visible and ignores unknown values", () => {
    expect(extentOf(curve([50, 1, NaN, 3, 70]), 0.1, 0.35)).toEqual({ low: 1, high: 3 });
  });
});
