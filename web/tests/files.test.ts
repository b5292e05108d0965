import { describe, expect, it } from "vitest";
import { csvOf } from "../src/logic/csv";
import { innovationSignals } from "../src/logic/aids";
import { fileStem, wireTitle } from "../src/logic/files";
import { laneSignal, signalsOfBoard } from "../src/logic/signals";

const roll = laneSignal("vqf", "roll");
const difference = laneSignal("vqf", "roll", "ins_ekf");
const baro = innovationSignals("baro_height", 0);

describe("a saved plot", () => {
  it("has columns that say where they are from and in which unit", () => {
    expect(
      [roll, difference, laneSignal("onboard", "pos_n_m"), baro.innovation, baro.sigma].map(wireTitle),
    ).toEqual([
      "lanes/vqf:roll [°]",
      "lanes/vqf:roll-ins_ekf [°]",
      "lanes/onboard:pos_n_m [m]",
      "aids/baro_height:innovation_0 [m]",
      "aids/baro_height:sigma_0 [m]",
    ]);
  });

  it("has no two columns of one name, whatever is plotted", () => {
    const titles = signalsOfBoard(["ins_ekf", "vqf"]).map(wireTitle);
    expect(new Set(titles).size).toBe(titles.length);
  });

  it("is named after what it shows", () => {
    expect([roll, difference, baro.innovation, undefined].map(fileStem)).toEqual([
      "roll",
      "roll-minus-ins_ekf",
      "baro_height-innovation_0",
      "",
    ]);
  });

  it("keeps every digit of a value and every nanosecond of a time", () => {
    const value = 0.1 + 0.2;
    const text = csvOf([{ name: "a", curve: { tS: Float64Array.of(12345.678901234), values: Float64Array.of(value) } }], 0, 2e4); // prettier-ignore
    const [tS, cell] = (text.split("\n")[1] ?? "").split(",").map(Number);
    expect(cell).toBe(value);
    expect(tS).toBe(12345.678901234);
  });
});
