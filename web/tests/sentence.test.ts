import { describe, expect, it } from "vitest";
import type { BoardOut, LaneOut } from "../src/api/wire";
import { en } from "../src/i18n/en";
import { fill } from "../src/i18n/index.svelte";
import { sentenceOf, type Situation } from "../src/logic/sentence";

const LANE: LaneOut = {
  lane: "ins_ekf",
  provides: "full",
  status: "navigating",
  failure: "",
  t_ns: 0,
  age_s: 0,
  sigma_heading_rad: 0.01,
  sigma_tilt_rad: 0.01,
  sigma_h_m: 0.78,
  sigma_v_m: 0.5,
  dead_reckoning_s: 0,
};

function situation(
  lane: Partial<LaneOut>,
  rest: Partial<Situation> = {},
  board: Partial<BoardOut> = {},
): Situation {
  const whole = {
    state: "running",
    link: { state: "open" },
    main_lane: "ins_ekf",
    lanes: [
      { ...LANE, lane: "onboard", status: "failed" },
      { ...LANE, ...lane },
    ],
    ...board,
  } as BoardOut;
  return { connection: { phase: "open" }, nowMs: 0, known: true, board: whole, ageS: 0.1, ...rest };
}

function said(given: Situation): [text: string, severity: string] {
  const { key, params, severity } = sentenceOf(given);
  return [fill(en[key], params), severity];
}

describe("the state sentence", () => {
  it.each<[string, Situation, [string, string]]>([
    ["navigating", situation({}), ["Navigating, 0.8 m", "ok"]],
    ["centimetres", situation({ sigma_h_m: 0.014 }), ["Navigating, 0.01 m", "ok"]],
    ["unknown size", situation({ sigma_h_m: null }), ["Navigating", "ok"]],
    [
      "dead reckoning",
      situation({ status: "dead_reckoning", dead_reckoning_s: 12.4, sigma_h_m: 6.3 }),
      ["Dead reckoning for 12 s, ± 6 m", "caution"],
    ],
    ["aligning", situation({ status: "aligning" }), ["Aligning: keep the vehicle still", "info"]],
    ["attitude", situation({ status: "attitude" }), ["Attitude only, heading ± 0.6°", "caution"]],
    ["failed", situation({ status: "failed" }), ["The estimator failed: do not use its values", "warning"]],
    ["silence", situation({}, { ageS: 3.2 }), ["No data for 3 s", "warning"]],
    ["a short hiccup", situation({}, { ageS: 1.5 }), ["Navigating, 0.8 m", "ok"]],
    ["nothing yet", situation({}, { ageS: null }), ["Waiting for the first data", "info"]],
    ["no estimator", situation({}, {}, { lanes: [] }), ["No estimator is running", "info"]],
    ["no board", situation({}, { board: null }), ["No board yet", "info"]],
    [
      "an ended recording",
      situation({}, { ageS: 60 }, { state: "ended" }),
      ["Recording played to its end", "info"],
    ],
    [
      "a failed board",
      situation({}, {}, { state: "failed" }),
      ["This board stopped with a fault", "warning"],
    ],
  ])("says it: %s", (_, given, expected) => {
    expect(said(given)).toEqual(expected);
  });

  it("lets the page's own lost connection shadow everything else", () => {
    const given = situation({}, { connection: { phase: "waiting", untilMs: 1700 }, nowMs: 0 });
    expect(said(given)).toEqual(["Connection to navdeck lost; trying again in 2 s", "warning"]);
  });

  it("does not flicker to another sentence while it tries again", () => {
    const given = situation({}, { connection: { phase: "connecting", again: true } });
    expect(said(given)).toEqual(["Connection to navdeck lost; trying again now", "warning"]);
  });

  it("speaks of the chosen lane, not of another", () => {
    expect(said(situation({}, {}, { main_lane: "onboard" }))[0]).toContain("failed");
  });
});
