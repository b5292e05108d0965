import { describe, expect, it } from "vitest";
import { csvOf } from "../src/logic/csv";
import { angleBetween } from "../src/logic/difference";
import {
  bytes,
  clock,
  compact,
  count,
  DASH,
  decimalsFor,
  duration,
  fixed,
  spread,
} from "../src/logic/format";
import { formatLatitude, formatLongitude, metresBetween } from "../src/logic/geodesy";
import { crc32 } from "../src/logic/crc32";
import { steadyRange } from "../src/logic/range";
import { matches } from "../src/logic/signals";
import { deviation } from "../src/logic/statistics";
import { shown } from "../src/logic/units";

describe("numbers for people", () => {
  it("never show zero for unknown", () => {
    expect([
      fixed(NaN, 1),
      fixed(null, 1),
      compact(undefined),
      count(Infinity),
      bytes(null),
      duration(NaN),
    ]).toEqual(Array.from({ length: 6 }, () => DASH));
  });

  it("have a real minus sign and no minus zero", () => {
    expect(fixed(-1.26, 1)).toBe("\u22121.3");
    expect(fixed(-0.04, 1)).toBe("0.0");
  });

  it("grow their unit with the size", () => {
    expect([412, 63_100, 45_900_000].map(bytes)).toEqual(["412 B", "63.1 kB", "45.9 MB"]);
    expect([0.42, 12.4, 119, 600, 9000, 400_000].map(duration)).toEqual([
      "0.4 s",
      "12 s",
      "119 s",
      "10 min",
      "2.5 h",
      "5 d",
    ]);
    expect(count(1234567)).toBe("1\u2009234\u2009567");
  });

  it("read times as a clock", () => {
    expect([clock(5), clock(65), clock(3723), clock(65.25, 1), clock(59.96, 1)]).toEqual([
      "0:05",
      "1:05",
      "1:02:03",
      "1:05.3",
      "1:00.0",
    ]);
  });

  it("keep enough decimals for the span of their plot, and no more", () => {
    expect([2000, 60, 5, 0.3, 0.001, 0, NaN].map(decimalsFor)).toEqual([0, 1, 2, 3, 6, 2, 2]);
  });

  it("say an uncertainty with the digits it deserves", () => {
    expect([0.014, 0.78, 2.4, 6.3, 140.2].map(spread)).toEqual(["0.01", "0.8", "2.4", "6", "140"]);
  });
});

describe("units", () => {
  it.each([
    ["gyro_x_rad_s", "gyro_x", "°/s", 180 / Math.PI],
    ["accel_z_m_s2", "accel_z", "m/s²", 1],
    ["vel_n_m_s", "vel_n", "m/s", 1],
    ["mag_x_gauss", "mag_x", "µT", 100],
    ["sigma_att_z_rad", "sigma_att_z", "°", 180 / Math.PI],
    ["pressure_pa", "pressure", "hPa", 0.01],
    ["dead_reckoning_s", "dead_reckoning", "s", 1],
    ["satellites", "satellites", "", 1],
  ])("are read from the end of %s", (column, quantity, unit, factor) => {
    expect(shown(column)).toEqual({ quantity, unit, factor });
  });
});

describe("geodesy", () => {
  it("gives a minute of arc along the meridian its nautical mile", () => {
    expect(metresBetween(45, 7, 45 + 1 / 60, 7).northM).toBeCloseTo(1852.2, 0);
  });

  it("gives a degree along the equator its length", () => {
    expect(metresBetween(0, 10, 0, 11).eastM).toBeCloseTo(111319.49, 1);
  });

  it("crosses the date line the short way", () => {
    expect(metresBetween(0, 179.9995, 0, -179.9995).eastM).toBeCloseTo(111.32, 1);
  });

  it("names the hemisphere", () => {
    expect([formatLatitude(-33.5), formatLongitude(-7.25), formatLatitude(NaN)]).toEqual([
      "33.5000000° S",
      "7.2500000° W",
      DASH,
    ]);
  });

  it("measures the angle between orientations whatever their sign", () => {
    const [c, s] = [Math.cos(0.15), Math.sin(0.15)];
    expect(angleBetween([1, 0, 0, 0], [c, 0, s, 0])).toBeCloseTo(0.3, 9);
    expect(angleBetween([1, 0, 0, 0], [-c, 0, -s, 0])).toBeCloseTo(0.3, 9);
    expect(angleBetween([1, 0, 0, 0], [NaN, 0, 0, 0])).toBeNaN();
  });
});

describe("steadyRange", () => {
  it("holds all values with some air", () => {
    const { min, max } = steadyRange(null, -3.2, 7.9, 0.1);
    expect(min).toBeLessThan(-3.2);
    expect(max).toBeGreaterThan(7.9);
  });

  it("does not twitch while the data stay inside and use a third of it", () => {
    const first = steadyRange(null, 0, 10, 0.1);
    expect(steadyRange(first, 2, 9, 0.1)).toBe(first);
    expect(steadyRange(first, 4.9, 5.1, 0.1)).not.toBe(first);
    expect(steadyRange(first, 0, 30, 0.1)).not.toBe(first);
  });

  it("shows a constant in the middle of the least span", () => {
    const { min, max } = steadyRange(null, 5, 5, 1);
    expect(min).toBeLessThan(5);
    expect(max).toBeGreaterThan(5);
    expect(max - min).toBeGreaterThanOrEqual(1);
  });

  it("has a range without data", () => {
    expect(steadyRange(null, Infinity, -Infinity, 1)).toEqual({ min: 0, max: 1 });
  });
});

describe("csvOf", () => {
  it("joins curves on time, empty where one has no value", () => {
    const a = { tS: Float64Array.of(1, 2, 3), values: Float64Array.of(10, NaN, 30) };
    const b = { tS: Float64Array.of(2, 2.5, 9), values: Float64Array.of(-1, -2, -3) };
    const text = csvOf(
      [
        { name: "roll [°]", curve: a },
        { name: 'b,"c"', curve: b },
      ],
      1,
      3,
    );
    expect(text).toBe(
      't_s,roll [°],"b,""c"""\n1.000000000,10,\n2.000000000,,-1\n2.500000000,,-2\n3.000000000,30,\n',
    );
  });
});

describe("small things", () => {
  it("crc32 has the standard check value", () => {
    expect(crc32("123456789")).toBe(0xcbf43926);
  });

  it("deviation leaves unknown values out", () => {
    expect(deviation([9, 2, 4, NaN, 4, 4, 5, 5, 7, 9], 1)).toBeCloseTo(2.138, 3);
    expect(deviation([1])).toBeNaN();
  });

  it("a search matches words in any order", () => {
    expect(matches("ekf roll", "Roll", "INS (EKF)")).toBe(true);
    expect(matches("ekf yaw", "Roll", "INS (EKF)")).toBe(false);
  });
});
