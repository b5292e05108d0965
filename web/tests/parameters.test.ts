import { describe, expect, it } from "vitest";
import type { ParameterOut } from "../src/api/wire";
import { isChanged, isSwitch, readSetting, shownUnit, told, written } from "../src/logic/parameters";

const TAU: ParameterOut = {
  name: "tau_accel_s",
  unit: "s",
  default: 3,
  minimum: 0.05,
  maximum: 100,
  meaning: "Time constant.",
  value: 3,
};
const RATE: ParameterOut = {
  ...TAU,
  name: "rest_gyro_rad_s",
  unit: "rad/s",
  default: (2 * Math.PI) / 180,
  minimum: 1e-4,
  maximum: 1,
  value: (2 * Math.PI) / 180,
};

describe("settings", () => {
  it.each([
    ["rad", "°", 180 / Math.PI],
    ["rad/s/√Hz", "°/s/√Hz", 180 / Math.PI],
    ["gauss", "µT", 100],
    ["m/s²", "m/s²", 1],
    ["", "", 1],
  ])("in %s are shown in %s", (unit, shown, factor) => {
    expect(shownUnit(unit)).toEqual({ unit: shown, factor });
  });

  it("are written as a person would, and read back as exactly that value", () => {
    expect(written(RATE.value, RATE)).toBe("2");
    expect(readSetting("2", RATE)).toEqual({ ok: true, value: RATE.default });
    expect(written(null, TAU)).toBe("");
    expect(written(0.1 + 0.2, TAU)).toBe("0.3");
  });

  it("take a decimal comma, a real minus sign, an exponent, and nothing for the default", () => {
    expect(readSetting(" 4,5 ", TAU)).toEqual({ ok: true, value: 4.5 });
    expect(readSetting("1e1", TAU)).toEqual({ ok: true, value: 10 });
    expect(readSetting("", TAU)).toEqual({ ok: true, value: null });
    expect(readSetting("\u22122", TAU)).toEqual({ ok: false, why: "range" });
  });

  it("refuse what is no number or outside the limits, which themselves are allowed", () => {
    for (const text of ["x", "1.2.3", "1,2,3", "NaN", "Infinity", "0x10", "--1", "3 s"])
      expect(readSetting(text, TAU), text).toEqual({ ok: false, why: "number" });
    expect(readSetting("100.1", TAU)).toEqual({ ok: false, why: "range" });
    expect(readSetting(told(TAU.maximum, TAU), TAU)).toEqual({ ok: true, value: 100 });
    expect(readSetting(told(RATE.maximum, RATE), RATE)).toEqual({ ok: true, value: 1 });
    expect(readSetting(told(RATE.minimum, RATE), RATE)).toEqual({ ok: true, value: 1e-4 });
  });

  it("tell limits of any size shortly", () => {
    expect([0.05, 100, 3, 1e-7, 0, 1e5, 0.0896].map((value) => told(value, TAU))).toEqual([
      "0.05",
      "100",
      "3",
      "1e\u22127",
      "0",
      "1e5",
      "0.0896",
    ]);
  });

  it("know when a person has changed them, also where the default is the vehicle's own", () => {
    expect(isChanged(TAU)).toBe(false);
    expect(isChanged({ ...TAU, value: 4 })).toBe(true);
    expect(isChanged({ ...TAU, default: null, value: null })).toBe(false);
    expect(isChanged({ ...TAU, default: null, value: 4 })).toBe(true);
  });

  it("of yes and no are told by their limits and their meaning", () => {
    const flag = { ...TAU, unit: "", minimum: 0, maximum: 1, meaning: "Past 0.5 it is used, else not." };
    expect(isSwitch(flag)).toBe(true);
    expect(isSwitch({ ...flag, meaning: "A share." })).toBe(false);
  });
});
