import { describe, expect, it } from "vitest";
import filter from "../../server/nav/ekf/delays.py?raw";
import type { DelayOut } from "../src/api/wire";
import { en } from "../src/i18n/en";
import { delayMs, delayOrigin, sensorDelayMs, spreadMs, USED_BELOW_S } from "../src/logic/delays";
import { DASH } from "../src/logic/format";

function delay(
  measurement: DelayOut["measurement"],
  source: DelayOut["source"],
  delay_s: number | null = null,
  sigma_s: number | null = null,
): DelayOut {
  return { measurement, source, delay_s, filter_s: null, sigma_s };
}

const TOLD = delay("imu", "board", 0.011);
const FOUND = [
  delay("gnss_position", "estimated", 0.112, 0.0041),
  delay("gnss_velocity", "estimated", -0.0048, 0.06),
];
const UNKNOWN = delay("baro", "unknown");

describe("delays", () => {
  it("are whole milliseconds, with their σ where they are estimated; nobody's is a dash, a told zero is zero", () => {
    const all = [TOLD, ...FOUND, UNKNOWN, delay("mag", "settings", 0)];
    expect(all.map(delayMs)).toEqual(["11", "112", "\u22125", DASH, "0"]);
    expect(all.map(spreadMs)).toEqual(["", "± 4", "± 60", "", ""]);
  });

  it("say who told them, and whether an estimate is sure enough to be used", () => {
    expect([TOLD, ...FOUND, UNKNOWN].map(delayOrigin)).toEqual(["board", "estimated", "unsure", "unknown"]);
    const texts = en as Readonly<Record<string, string>>;
    for (const origin of ["settings", "board", "estimated", "unsure", "unknown"])
      expect(texts[`delay.from.${origin}`]).toBeTruthy();
  });

  it("are used from the filter's own limit on", () => {
    const limitS2 = Number(/^SURE_S2: Final = ([\d.e-]+)/m.exec(filter)?.[1]);
    expect(USED_BELOW_S).toBeCloseTo(Math.sqrt(limitS2), 9);
  });

  it("of one sensor are one text, said once where they are the same", () => {
    const same = [delay("gnss_position", "board", 0.098), delay("gnss_velocity", "board", 0.098)];
    expect(sensorDelayMs([TOLD, ...same], "gnss")).toBe("98");
    expect(sensorDelayMs([TOLD, ...FOUND], "gnss")).toBe("112 ± 4 / \u22125 ± 60");
    expect(sensorDelayMs([TOLD], "airspeed")).toBe(DASH);
  });
});
