import { describe, expect, it } from "vitest";
import typesSource from "../../server/nav/types.py?raw";
import palette from "../../server/view3d/palette.py?raw";
import {
  AID_COLUMNS,
  AID_STATUS,
  AIDS,
  LANE_COLUMNS,
  LANE_STATUS,
  SAMPLE_COLUMNS,
  STEP_COLUMNS,
} from "../src/live/columns";
import { LANE_COLOURS, SPARE_COLOURS } from "../src/ui/lanes";

/** Comments may hold brackets. */
const types = typesSource.replace(/ *#.*/g, "");

function strings(text: string): string[] {
  return [...text.matchAll(/"([a-z0-9_]+)"/g)].map((match) => match[1] ?? "");
}

function tuple(name: string): string[] {
  return strings(new RegExp(`^${name}: Final = \\(([^)]*)\\)`, "m").exec(types)?.[1] ?? "");
}

function members(name: string): string[] {
  const body = new RegExp(`^class ${name}\\(IntEnum\\):([\\s\\S]*?)\\n\\n\\n`, "m").exec(types)?.[1] ?? "";
  return [...body.matchAll(/^ {4}([A-Z_0-9]+) = \d+/gm)].map((match) => (match[1] ?? "").toLowerCase());
}

describe("the page's idea of the rows", () => {
  it.each([
    ["LANE_COLUMNS", LANE_COLUMNS],
    ["STEP_COLUMNS", STEP_COLUMNS],
    ["AID_COLUMNS", AID_COLUMNS],
  ])("has the server's %s", (name, columns) => {
    expect([...columns]).toEqual(tuple(name));
  });

  it.each(Object.entries(SAMPLE_COLUMNS))("has the server's columns of raw/%s", (kind, columns) => {
    const body = new RegExp(`Kind\\.${kind.toUpperCase()}: \\(([^)]*)\\)`).exec(types)?.[1] ?? "";
    expect([...columns]).toEqual(strings(body));
  });

  it.each([
    ["LaneStatus", LANE_STATUS],
    ["Aid", AIDS],
    ["AidStatus", AID_STATUS],
  ])("has the server's %s in its order", (name, values) => {
    expect([...values]).toEqual(members(name));
  });
});

function hex(rgb: string): string {
  return `#${rgb
    .split(",")
    .map((each) => Number(each).toString(16).padStart(2, "0"))
    .join("")}`;
}

describe("lane colours", () => {
  it("are those of the 3D view in both themes", () => {
    for (const name of ["dark", "light"] as const) {
      const line = new RegExp(`^ {4}"${name}": \\{\\n([^}]*"ins_ekf"[^}]*)\\}`, "m").exec(palette)?.[1] ?? "";
      const found = [...line.matchAll(/"(\w+)": \(([\d, ]+)\)/g)].map((match) => [
        match[1],
        hex(match[2] ?? ""),
      ]);
      expect(Object.fromEntries(found)).toEqual(LANE_COLOURS[name]);
    }
  });

  it("of further lanes come from the same reserve", () => {
    const reserve = /^SPARE_RGB.* = \((.*)\)$/m.exec(palette)?.[1] ?? "";
    expect([...reserve.matchAll(/\(([\d, ]+)\)/g)].map((match) => hex(match[1] ?? ""))).toEqual([
      ...SPARE_COLOURS,
    ]);
  });
});
