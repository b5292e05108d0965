import { describe, expect, it } from "vitest";
import { Ring } from "../src/live/ring";
import { rowsOf } from "./helpers";

function counted(from: number, to: number): [number[], number[][]] {
  const t = Array.from({ length: to - from }, (_, i) => from + i);
  return [t, t.map((each) => [each * 10, -each])];
}

function held(ring: Ring): [number[], number[]] {
  const micro = (tS: number): number => Math.round(tS * 1e6) / 1e6;
  return [[...ring.times()].map(micro), [...ring.column(0)]];
}

describe("Ring", () => {
  it("keeps the newest rows, however they are cut into messages", () => {
    const whole = new Ring(["a", "b"], 10);
    const cut = new Ring(["a", "b"], 10);
    whole.append(rowsOf(...counted(0, 57)));
    for (let i = 0; i < 57; i += 3) cut.append(rowsOf(...counted(i, i + 3)));
    expect(held(cut)).toEqual(held(whole));
    expect(held(whole)[0]).toEqual([47, 48, 49, 50, 51, 52, 53, 54, 55, 56]);
    expect(whole.newest("b")).toBe(-56);
  });

  it("finds the row at or before a time", () => {
    const ring = new Ring(["a", "b"], 10);
    ring.append(
      rowsOf(
        [1, 2, 4],
        [
          [1, 1],
          [2, 2],
          [4, 4],
        ],
      ),
    );
    expect([0.9, 1, 3.9, 4, 9].map((t) => ring.indexAt(t))).toEqual([-1, 0, 1, 2, 2]);
  });

  it("ignores a row that repeats and puts a late one in its place", () => {
    const ring = new Ring(["a", "b"], 10);
    const before = ring.revision;
    ring.append(rowsOf([1, 2, 2, 3].map(Number), [[1, 0], [2, 0], [9, 0], [3, 0]])); // prettier-ignore
    expect(ring.revision).toBe(before);
    ring.append(rowsOf([2.75], [[7, 0]]));
    ring.append(rowsOf([2.25], [[8, 0]])); // later than any message of one board can be
    expect(held(ring)).toEqual([
      [1, 2, 2.75, 3],
      [1, 2, 7, 3],
    ]);
    expect(ring.revision).toBe(before + 1);
  });

  it("makes one row of the rows of one moment, which knows what either knew", () => {
    const ring = new Ring(["a", "b"], 10);
    const rows: [number, number[]][] = [
      [1, [10, NaN]],
      [1, [NaN, 11]],
      [2, [NaN, 21]],
      [2, [20, NaN]],
    ];
    for (const [t, row] of rows) ring.append(rowsOf([t], [row]));
    expect(held(ring)).toEqual([
      [1, 2],
      [10, 20],
    ]);
    expect([...ring.column(1)]).toEqual([11, 21]);
  });

  it("loses nothing of late rows where its arrays are full", () => {
    const ring = new Ring(["a", "b"], 10);
    for (let i = 0; i < 57; i++) {
      ring.append(rowsOf([i + 0.25], [[10 * i + 1, 0]]));
      ring.append(rowsOf([i], [[10 * i, 0]]));
    }
    expect(held(ring)).toEqual([
      [52, 53, 54, 55, 56].flatMap((t) => [t, t + 0.25]),
      [52, 53, 54, 55, 56].flatMap((t) => [10 * t, 10 * t + 1]),
    ]);
  });

  it("forgets the old power-up when a new one speaks", () => {
    const ring = new Ring(["a", "b"], 10);
    ring.append(rowsOf([100], [[1, 0]], 0));
    ring.append(rowsOf([1], [[2, 0]], 1));
    expect(held(ring)).toEqual([[1], [2]]);
  });

  it("forgets the old times when a restarted service begins anew under the same number", () => {
    const ring = new Ring(["a", "b"], 10);
    ring.append(rowsOf([100], [[1, 0]]));
    ring.append(
      rowsOf(
        [5, 6],
        [
          [2, 0],
          [3, 0],
        ],
      ),
    );
    expect(held(ring)).toEqual([
      [5, 6],
      [2, 3],
    ]);
  });

  it("refuses rows of another width", () => {
    const ring = new Ring(["a", "b"], 10);
    ring.append(rowsOf([1], [[1, 2, 3]]));
    expect(ring.length).toBe(0);
  });

  it("keeps latitude to a millimetre", () => {
    const ring = new Ring(["lat_deg"], 4);
    ring.append(rowsOf([1], [[47.123456789]]));
    expect(ring.newest("lat_deg")).toBe(47.123456789);
  });

  it("answers NaN for what is not there", () => {
    const ring = new Ring(["a"], 4);
    expect(ring.newestS).toBeNaN();
    expect(ring.newest("a")).toBeNaN();
    expect(ring.newest("unheard")).toBeNaN();
  });
});

describe("Ring.fill", () => {
  it("puts history before what is held and into gaps, and nowhere else", () => {
    const ring = new Ring(["a"], 100);
    ring.append(rowsOf([10, 10.03125, 10.0625], [[1], [2], [3]]));
    ring.append(rowsOf([12, 12.03125], [[4], [5]]));
    ring.fill(rowsOf([9.8, 9.9, 10, 10.1, 11, 12, 12.1], [[-1], [-2], [-3], [-4], [-5], [-6], [-7]]));
    expect(held(ring)).toEqual([
      [9.8, 9.9, 10, 10.03125, 10.0625, 11, 12, 12.03125],
      [-1, -2, 1, 2, 3, -5, 4, 5],
    ]);
  });

  it("takes every row of a history in which attitude and position come in turns", () => {
    const ring = new Ring(["q", "p"], 100);
    ring.append(rowsOf([10, 10.02], [[5, NaN], [6, NaN]])); // prettier-ignore
    const [t, rows] = [[9, 9.005, 9.1, 9.105, 9.2, 9.2], [[1, NaN], [NaN, 2], [3, NaN], [NaN, 4], [8, NaN], [NaN, 9]]]; // prettier-ignore
    ring.fill(rowsOf(t, rows));
    expect(held(ring)).toEqual([
      [9, 9.005, 9.1, 9.105, 9.2, 10, 10.02],
      [1, NaN, 3, NaN, 8, 5, 6],
    ]);
    expect([...ring.column(1)]).toEqual([NaN, 2, NaN, 4, 9, NaN, NaN]);
  });

  it("does not mix power-ups", () => {
    const ring = new Ring(["a"], 100);
    ring.append(rowsOf([10], [[1]], 3));
    ring.fill(rowsOf([9], [[2]], 2));
    expect(held(ring)).toEqual([[10], [1]]);
  });

  it("tells that old positions are no longer valid", () => {
    const ring = new Ring(["a"], 100);
    ring.append(rowsOf([10], [[1]]));
    const before = ring.epoch;
    ring.fill(rowsOf([9], [[2]]));
    expect(ring.epoch).toBeGreaterThan(before);
  });
});
