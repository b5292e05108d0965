import { describe, expect, it } from "vitest";
import type { Feed } from "../src/live/feeds";
import { LANE_COLUMNS } from "../src/live/columns";
import { Ring } from "../src/live/ring";
import { Trace } from "../src/live/trace";
import { gateOf, innovationSignals } from "../src/logic/aids";
import type { AidOut } from "../src/api/wire";
import { eulerFromQuat } from "../src/logic/angles";
import { differenceOf, newestKnown, valueAround, wrapped } from "../src/logic/difference";
import { laneRow, quatOf } from "../src/logic/laneRow";
import { laneSignal, type Signal } from "../src/logic/signals";
import { rowsOf } from "./helpers";

const PLAIN = { wraps: 0, read: (ring: Ring, i: number) => ring.value(i, "a") };
const TURN = { ...PLAIN, wraps: 360 };

function ringOf(tS: readonly number[], values: readonly number[]): Ring {
  const ring = new Ring(["a"], 1000);
  ring.append(
    rowsOf(
      tS,
      values.map((value) => [value]),
    ),
  );
  return ring;
}

/** Rows of a lane with roll, pitch, heading (deg), north, east and down (m). */
function laneRing(rows: readonly (readonly [t: number, ...state: number[]])[]): Ring {
  const ring = new Ring(LANE_COLUMNS, 1000);
  const full = rows.map(([, roll = NaN, pitch = NaN, heading = NaN, north = NaN, east = NaN, down = NaN]) => {
    const row = LANE_COLUMNS.map(() => NaN);
    const set = (name: (typeof LANE_COLUMNS)[number], value: number): void => {
      row[LANE_COLUMNS.indexOf(name)] = value;
    };
    quatOf(roll, pitch, heading).forEach((each, i) => (row[i] = each));
    set("pos_n_m", north);
    set("pos_e_m", east);
    set("pos_d_m", down);
    return row;
  });
  ring.append(
    rowsOf(
      rows.map(([t]) => t),
      full,
    ),
  );
  return ring;
}

describe("valueAround", () => {
  it("is the row's own at its time and lies between the rows elsewhere", () => {
    const ring = ringOf([1, 1.1, 1.2], [0, 10, 30]);
    expect(valueAround(ring, 1.1, PLAIN)).toBe(10);
    expect(valueAround(ring, 1.15, PLAIN)).toBeCloseTo(20, 6);
  });

  it("passes over rows that do not know", () => {
    expect(valueAround(ringOf([1, 1.1, 1.2], [0, NaN, 20]), 1.1, PLAIN)).toBeCloseTo(10, 6);
  });

  it("goes the short way round", () => {
    const value = valueAround(ringOf([1, 1.2], [350, 10]), 1.1, TURN) ?? NaN;
    expect(wrapped(value, 360)).toBeCloseTo(0, 6);
  });

  it("waits for a row that may still come, and knows nothing of a silence", () => {
    const ring = ringOf([1, 1.1], [0, 10]);
    expect(valueAround(ring, 1.15, PLAIN)).toBeUndefined();
    ring.append(rowsOf([3], [[0]]));
    expect(valueAround(ring, 1.15, PLAIN)).toBeNaN();
    expect(valueAround(ring, 2, PLAIN)).toBeNaN();
  });
});

describe("differenceOf", () => {
  it("compares at the newest moment that both know, signed and the short way round", () => {
    const mine = ringOf([1, 1.1, 1.2], [358, 359, 1]);
    const other = ringOf([1.05, 1.15], [3, 5]);
    expect(differenceOf(mine, other, TURN)).toBeCloseTo(-5, 3);
    expect(differenceOf(other, mine, TURN)).toBeCloseTo(5, 3);
  });

  it("is unknown when one has fallen silent", () => {
    expect(differenceOf(ringOf([1, 9], [1, 2]), ringOf([1], [1]), PLAIN)).toBeNaN();
    expect(differenceOf(ringOf([1], [1]), new Ring(["a"], 4), PLAIN)).toBeNaN();
  });

  it("takes the newest known value, but not an old one", () => {
    expect(newestKnown(ringOf([1, 1.1], [7, NaN]), PLAIN)).toEqual({ tS: 1, value: 7 });
    expect(newestKnown(ringOf([1, 2], [7, NaN]), PLAIN).value).toBeNaN();
  });
});

describe("laneRow", () => {
  it("says how far apart two lanes are, per quantity, in angle and over ground", () => {
    const mine = laneRing([[1, 2, -3, 359, 10, 20, -5]]);
    const other = laneRing([[1, 1, -1, 2, 7, 24, -4]]);
    const { cells, apartDeg, apartM } = laneRow(mine, other);
    expect(cells.roll.value).toBeCloseTo(2, 3);
    expect(cells.heading.value).toBeCloseTo(359, 3);
    expect(cells.heading.difference).toBeCloseTo(-3, 3);
    expect(cells.height).toEqual({ value: 5, difference: 1 });
    expect(apartM).toBeCloseTo(5, 4);
    expect(apartDeg).toBeCloseTo(Math.hypot(1, 2, 3), 1);
  });

  it("leaves open what a lane does not know", () => {
    const { cells, apartDeg, apartM } = laneRow(laneRing([[1, 2, 3, 4]]), laneRing([[1, 2, 3, 4, 5, 6, 7]]));
    expect(cells.height.value).toBeNaN();
    expect(apartM).toBeNaN();
    expect(apartDeg).toBeCloseTo(0, 2);
  });

  it("turns angles into the orientation they are read back from", () => {
    const { rollRad, pitchRad, yawRad } = eulerFromQuat(quatOf(12, -34, 56));
    const deg = [rollRad, pitchRad, yawRad].map((each) => (each * 180) / Math.PI);
    expect(deg[0]).toBeCloseTo(12, 9);
    expect(deg[1]).toBeCloseTo(-34, 9);
    expect(deg[2]).toBeCloseTo(56, 9);
  });
});

describe("a curve of differences", () => {
  const signal = { ...laneSignal("vqf", "roll", "ins_ekf"), ...PLAIN } as Signal;
  const feedOf = (ring: Ring): Feed => ({ ring }) as unknown as Feed;

  it("grows row by row as soon as the other lane has reached the row", () => {
    const [mine, other] = [ringOf([1, 1.1], [5, 6]), ringOf([1], [2])];
    const trace = new Trace(signal, feedOf(mine), feedOf(other));
    trace.update();
    expect([...trace.curve().values]).toEqual([3]);
    other.append(rowsOf([1.1], [[2.5]]));
    trace.update();
    expect([...trace.curve().values]).toEqual([3, 3.5]);
  });

  it("takes in a row that came late, and what a row learned of its moment afterwards", () => {
    const columns = { ...laneSignal("onboard", "roll"), ...PLAIN } as Signal;
    const ring = new Ring(["a", "b"], 100);
    const trace = new Trace(columns, feedOf(ring));
    const points = (): number[][] => [[...trace.curve().tS], [...trace.curve().values]];
    ring.append(rowsOf([1, 1.25, 1.5], [[1, NaN], [NaN, 7], [3, NaN]])); // prettier-ignore
    trace.update();
    expect(points()).toEqual([
      [1, 1.25, 1.5],
      [1, NaN, 3],
    ]);
    ring.append(rowsOf([1.25], [[2, NaN]]));
    ring.append(rowsOf([1.375], [[2.5, NaN]]));
    trace.update();
    expect(points()).toEqual([
      [1, 1.25, 1.375, 1.5],
      [1, 2, 2.5, 3],
    ]);
  });

  it("starts over when the history of the other lane arrives", () => {
    const [mine, other] = [ringOf([1, 1.5], [5, 6]), ringOf([1.5], [2])];
    const trace = new Trace(signal, feedOf(mine), feedOf(other));
    trace.update();
    expect([...trace.curve().values]).toEqual([NaN, 4]);
    other.fill(rowsOf([1], [[1]]));
    trace.update();
    expect([...trace.curve().values]).toEqual([4, 4]);
  });

  it("has an identity of its own beside the lane's own curve", () => {
    expect(laneSignal("vqf", "roll", "ins_ekf").id).not.toBe(laneSignal("vqf", "roll").id);
  });
});

describe("innovations", () => {
  const aid = { innovation: [0.6, -2, 0.1], innovation_sigma: [0.5, 1, 1] } as unknown as AidOut;

  it("give away the gate they were judged by", () => {
    expect(gateOf({ ...aid, test_ratio: 4 / 9 }, 5)).toBeCloseTo(3, 6);
    expect(gateOf({ ...aid, test_ratio: null }, 5)).toBe(5);
    expect(gateOf({ ...aid, innovation: [0], innovation_sigma: [1], test_ratio: 0 }, 5)).toBe(5);
  });

  it("are shown in the unit of the screen, with their σ, and apart where refused", () => {
    const { innovation, sigma, refused } = innovationSignals("mag_field", 1);
    const ring = new Ring(innovation.columns, 4);
    const row = (status: number): number[] =>
      innovation.columns.map((name) =>
        name === "status"
          ? status
          : name === "innovation_1"
            ? 0.02
            : name === "innovation_var_1"
              ? 1e-4
              : NaN,
      );
    ring.append(rowsOf([1, 2, 3], [row(0), row(1), row(3)]));
    expect(innovation.read(ring, 2)).toBeCloseTo(2, 5);
    expect(sigma.read(ring, 0)).toBeCloseTo(1, 5);
    expect([0, 1, 2].map((i) => Number.isNaN(refused.read(ring, i)))).toEqual([true, false, true]);
  });
});
