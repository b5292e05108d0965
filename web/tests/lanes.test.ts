import { describe, expect, it } from "vitest";
import registry from "../../server/nav/lanes/registry.py?raw";
import type { LaneChoiceOut } from "../src/api/wire";
import { en } from "../src/i18n/en";
import { parameterTexts } from "../src/i18n/parameters";
import {
  asMain,
  knows,
  laneShape,
  laneState,
  runningLanes,
  switchedOff,
  switchedOn,
  yardstickOf,
} from "../src/logic/lanes";
import { LANE_COLOURS, LANE_KINDS } from "../src/ui/lanes";

const KINDS = ["full", "attitude", "altitude"] as const;

/** Names and kinds as the server's own files say them. */
const laneSources = Object.values(
  import.meta.glob<string>("../../server/nav/lanes/*.py", { query: "?raw", import: "default", eager: true }),
);
function keysOf(table: string): string[] {
  const body = new RegExp(`^${table}[^{]*\\{([^}]*)\\}`, "m").exec(registry)?.[1] ?? "";
  return [...body.matchAll(/"(\w+)":/g)].map((match) => match[1] ?? "");
}
const everyLane = ["ESTIMATORS", "REPEATERS", "AFTERWARDS"].flatMap(keysOf);

type Rgb = readonly [number, number, number];

function linear(hex: string): Rgb {
  const [r = 0, g = 0, b = 0] = [1, 3, 5]
    .map((at) => parseInt(hex.slice(at, at + 2), 16) / 255)
    .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return [r, g, b];
}

function times(m: readonly Rgb[], v: Rgb): Rgb {
  const [x = 0, y = 0, z = 0] = m.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
  return [x, y, z];
}

/** Machado, Oliveira and Fernandes 2009, severity 1, in linear RGB: as seen, without red, green or blue cones. */
const EYES: readonly (readonly Rgb[])[] = [
  [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
  [
    [0.152286, 1.052583, -0.204868],
    [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
  ],
  [
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.01182, 0.04294, 0.968881],
  ],
  [
    [1.255528, -0.076749, -0.178779],
    [-0.078411, 0.930809, 0.147602],
    [0.004733, 0.691367, 0.3039],
  ],
];

/** Ottosson's OKLab, in which equal steps look equally large. */
function oklab(rgb: Rgb): Rgb {
  const lms = times(
    [
      [0.4122214708, 0.5363325363, 0.0514459929],
      [0.2119034982, 0.6806995451, 0.1073969566],
      [0.0883024619, 0.2817188376, 0.6299787005],
    ],
    rgb.map((c) => Math.min(1, Math.max(0, c))) as unknown as Rgb,
  ).map(Math.cbrt) as unknown as Rgb;
  return times(
    [
      [0.2104542553, 0.793617785, -0.0040720468],
      [1.9779984951, -2.428592205, 0.4505937099],
      [0.0259040371, 0.7827717662, -0.808675766],
    ],
    lms,
  );
}

function apart(a: string, b: string, eye: readonly Rgb[]): number {
  const [p, q] = [a, b].map((hex) => oklab(times(eye, linear(hex)))) as [Rgb, Rgb];
  return Math.hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);
}

function contrast(a: string, b: string): number {
  const [light = 0, dark = 0] = [a, b]
    .map((hex) => linear(hex))
    .map(([r, g, bl]) => 0.2126 * r + 0.7152 * g + 0.0722 * bl + 0.05)
    .sort((x, y) => y - x);
  return light / dark;
}

describe("lane colours", () => {
  const panels = { dark: ["#1a222b", "#222c37"], light: ["#ffffff", "#f1f5f8"] } as const;

  it("are there for every lane of the server, which all have their kind", () => {
    const all = [...everyLane].sort();
    expect(all).toContain("smoother");
    expect(Object.keys(LANE_KINDS).sort()).toEqual(all);
    expect(Object.keys(LANE_COLOURS.dark).sort()).toEqual(all);
    expect(Object.keys(LANE_COLOURS.light).sort()).toEqual(all);
  });

  it.each(KINDS)("of one dash pattern (%s) stay apart for every eye", (kind) => {
    const lanes = Object.keys(LANE_KINDS).filter((lane) => LANE_KINDS[lane] === kind);
    for (const theme of ["dark", "light"] as const)
      for (const [i, a] of lanes.entries())
        for (const b of lanes.slice(i + 1))
          for (const eye of EYES)
            expect(
              apart(LANE_COLOURS[theme][a] ?? "", LANE_COLOURS[theme][b] ?? "", eye),
              `${theme} ${a} ${b}`,
            ).toBeGreaterThan(0.055);
  });

  it("stand out of their panels as WCAG wants it of graphics", () => {
    for (const theme of ["dark", "light"] as const)
      for (const [lane, colour] of Object.entries(LANE_COLOURS[theme]))
        for (const panel of panels[theme])
          expect(contrast(colour, panel), `${theme} ${lane}`).toBeGreaterThan(3);
  });
});

describe("words for lanes", () => {
  it("are there for every lane and every setting of the server", () => {
    const texts = en as Readonly<Record<string, string>>;
    const unnamed = everyLane.filter((lane) => !texts[`lane.name.${lane}`] || !texts[`lane.is.${lane}`]);
    expect(unnamed).toEqual([]);
    const parameters = laneSources.flatMap((source) =>
      [...source.matchAll(/Parameter\(\s*name="(\w+)"/g)].map((match) => match[1] ?? ""),
    );
    expect(parameters.length).toBeGreaterThan(30);
    expect(parameters.filter((name) => !parameterTexts[name])).toEqual([]);
  });
});

function choice(name: string, rest: Partial<LaneChoiceOut> = {}): LaneChoiceOut {
  const provides = LANE_KINDS[name] ?? "full";
  const plain = { chosen: true, running: true, failure: "", status: null, parameters: [] };
  return { name, provides, ...plain, ...rest };
}

describe("choosing lanes", () => {
  const kinds = (lane: string) => LANE_KINDS[lane] ?? "full";

  it("adds at the end, once, so that the main one stays", () => {
    expect(switchedOn(["ins_ekf", "vqf"], "dmp")).toEqual(["ins_ekf", "vqf", "dmp"]);
    expect(switchedOn(["ins_ekf"], "ins_ekf")).toEqual(["ins_ekf"]);
  });

  it("hands the display to the next full estimator, not to a repeater or a height", () => {
    const chosen = ["ins_ekf", "onboard", "altitude_kalman", "nav_position"];
    expect(switchedOff(chosen, "ins_ekf", kinds)[0]).toBe("nav_position");
    expect(switchedOff(chosen, "onboard", kinds)).toEqual(["ins_ekf", "altitude_kalman", "nav_position"]);
    expect(switchedOff(["ins_ekf", "onboard"], "ins_ekf", kinds)).toEqual(["onboard"]);
  });

  it("puts the main one first", () => {
    expect(asMain(["ins_ekf", "vqf"], "vqf")).toEqual(["vqf", "ins_ekf"]);
  });

  it("knows those that run, in the order chosen", () => {
    const all = [choice("ins_ekf"), choice("vqf"), choice("dmp", { running: false, failure: "x" })];
    expect(runningLanes(all, ["vqf", "dmp", "ins_ekf"]).map((each) => each.name)).toEqual(["vqf", "ins_ekf"]);
  });

  it("compares with what was picked while it runs, else with the main one", () => {
    const running = [choice("ins_ekf"), choice("reference")];
    expect(yardstickOf("reference", running)).toBe("reference");
    expect(yardstickOf("vqf", running)).toBe("ins_ekf");
    expect(yardstickOf("vqf", [])).toBe("");
  });
});

describe("the state of a lane", () => {
  it("is said in one word, the failure before the status", () => {
    expect(laneState(choice("vqf", { chosen: false }), undefined)).toBe("off");
    expect(laneState(choice("vqf"), undefined)).toBe("starting");
    expect(laneState(choice("vqf", { status: "aligning" }), undefined)).toBe("aligning");
    expect(laneState(choice("vqf", { failure: "ZeroDivisionError", status: "attitude" }), undefined)).toBe(
      "aside",
    );
  });

  it("is well for an attitude lane that has its attitude, a caution for one that could do more", () => {
    expect(laneShape("attitude", "attitude")).toBe("ok");
    expect(laneShape("attitude", "full")).toBe("caution");
    expect(laneShape("aside", "full")).toBe("warning");
  });

  it("tells what each kind knows", () => {
    expect([knows("full", "pos_n_m"), knows("attitude", "roll"), knows("altitude", "height")]).toEqual([
      true,
      true,
      true,
    ]);
    expect([knows("attitude", "height"), knows("altitude", "roll"), knows("altitude", "pos_e_m")]).toEqual([
      false,
      false,
      false,
    ]);
  });
});
