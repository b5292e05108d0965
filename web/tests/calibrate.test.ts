import { describe, expect, it } from "vitest";
import codesSource from "../../server/nav/calibration/codes.py?raw";
import typesSource from "../../server/nav/calibration/types.py?raw";
import wireSource from "../../server/wire_calibration.py?raw";
import chainSource from "../../server/nav/preprocess/chain_parameters.py?raw";
import navTypes from "../../server/nav/types.py?raw";
import type { JobOut, SimulatorOut } from "../src/api/wire";
import { calibrateCodesZh } from "../src/i18n/calibrateCodes.zh";
import { chainKey, chainTexts } from "../src/i18n/chainParameters";
import { en } from "../src/i18n/en";
import { STAGE_COLUMNS } from "../src/live/columns";
import {
  CAL_KINDS,
  cardState,
  checkShare,
  FACES,
  instructionOf,
  jobOf,
  offersOf,
  poseParts,
  sensorOf,
  stepOf,
} from "../src/logic/calibrate";
import { diffRows } from "../src/logic/calibrateDiff";
import { forPeople, improvement, namedNumber, numberRows, pairRows } from "../src/logic/calibrateNumbers";
import { optionsOf, typed, type Choices } from "../src/logic/calibrateOptions";
import { askedOf } from "../src/logic/demo";
import { chartStages, SENSOR_CHARTS } from "../src/logic/sensorCharts";

const PROGRESS: JobOut["progress"] = {
  fraction: 0.5,
  phase: "rotate",
  instruction: "rotate-all-ways",
  faces: {},
  face_now: "",
  face_next: "",
  pose_target_b: [],
  poses: 0,
  restarts: 0,
  samples: 10,
  is_enough: false,
  is_complete: false,
  values: {},
  uncovered_b: [],
  offset: [],
  matrix: [],
};
const JOB: JobOut = {
  id: "j1",
  board_id: "sim",
  kind: "mag_ellipsoid",
  sensor: "mag",
  state: "collecting",
  active: true,
  dry_run: false,
  created_utc: "2026-01-01T00:00:00Z",
  created_by: "operator",
  elapsed_s: 1,
  timeout_s: 900,
  progress: PROGRESS,
  refusal: null,
  result: null,
  comparison: null,
  check: null,
  check_failure: null,
  set_id: "",
  samples_file: "",
  lost_results: 0,
};
const LYING: SimulatorOut = {
  board_id: "sim",
  mode: "in-hand",
  action: "pose",
  name: "level",
  is_moving: false,
  remaining_s: 0,
  q_nb: [1, 0, 0, 0],
  down_b: [0, 0, 1],
  magnet_b_gauss: [],
  room_n_gauss: [],
  is_wind_on_pitot: false,
  has_airspeed: true,
  is_uncalibrated: true,
  link_back_s: 0,
};

function doing(part: Partial<JobOut["progress"]>, job: Partial<JobOut> = {}): JobOut {
  return { ...JOB, ...job, progress: { ...PROGRESS, ...part } };
}

function strings(text: string): string[] {
  return [...text.matchAll(/"([a-z0-9_-]+)"/g)].map((match) => match[1] ?? "");
}

describe("what the page knows of the service's calibrations", () => {
  it("is every reason to refuse, in Chinese too", () => {
    const codes = [...codesSource.matchAll(/^ {4}"([a-z-]+)":/gm)].map((match) => match[1] ?? "");
    expect(codes.length).toBeGreaterThan(20);
    expect(Object.keys(calibrateCodesZh).sort()).toEqual(codes.sort());
  });

  it("is every kind, each with its words", () => {
    const kinds = strings(/KindName = Literal\[([^\]]*)\]/.exec(wireSource)?.[1] ?? "");
    expect([...CAL_KINDS].sort()).toEqual(kinds.sort());
    const wanted = kinds.flatMap((kind) =>
      ["kind", "is", "need", "check", "limits"].map((part) => `cal.${part}.${kind}`),
    );
    expect(wanted.filter((key) => !(key in en))).toEqual([]);
  });

  it("is the six faces", () => {
    expect([...FACES]).toEqual(strings(/^FACES: Final = \(([^)]*)\)/m.exec(typesSource)?.[1] ?? ""));
  });

  it("is every instruction, each with its words", () => {
    const said = strings(/instruction: code of the next move([\s\S]*?)faces:/.exec(typesSource)?.[1] ?? "");
    expect(said.length).toBeGreaterThan(6);
    const keys = said.map((instruction) => instructionOf(doing({ instruction })).key);
    expect(keys.filter((key) => !(key in en))).toEqual([]);
    expect(
      said.filter(
        (each) => each !== "wait" && instructionOf(doing({ instruction: each })).key === "cal.do.wait",
      ),
    ).toEqual([]);
  });

  it("is every setting of a chain, each with its words", () => {
    const names = [...chainSource.matchAll(/_one\(\s*f?"([^"]+)"/g)].map((match) =>
      (match[1] ?? "").replace("{axis}", "x").replace("{word}", "rad_s").replace("{angle}", "roll"),
    );
    expect(names.length).toBeGreaterThan(10);
    expect(names.filter((name) => !(chainKey(name) in chainTexts))).toEqual([]);
  });

  it("is the unit of every stage", () => {
    const units = [...navTypes.matchAll(/"(\w+)": \(?\*?_stages\("(\w+)"/g)].map((match) => [
      match[1],
      match[2],
    ]);
    expect(units.map(([sensor]) => sensor)).toEqual(Object.keys(STAGE_COLUMNS));
    const ours = Object.entries(STAGE_COLUMNS).map(([sensor, columns]) => [
      sensor,
      columns[0]?.replace(/^calibrated(_x)?_/, ""),
    ]);
    expect(ours).toEqual(units);
  });
});

describe("a job", () => {
  it.each([
    [null, "prepare"],
    [doing({}, { state: "waiting" }), "collect"],
    [doing({}, { state: "paused" }), "collect"],
    [doing({}, { state: "fitted" }), "result"],
    [doing({}, { state: "verifying" }), "result"],
    [doing({}, { state: "verifying", set_id: "s" }), "apply"],
    [doing({}, { state: "applied", set_id: "s" }), "apply"],
    [doing({}, { state: "cancelled" }), "prepare"],
  ] as const)("stands at a step of its wizard", (job, step) => {
    expect(stepOf(job)).toBe(step);
  });

  it("offers the fit always while it collects, in front once there is enough", () => {
    expect(offersOf(doing({})).fitNow).toBe("secondary");
    expect(offersOf(doing({ is_enough: true })).fitNow).toBe("primary");
    expect(offersOf(doing({}, { state: "paused" })).cancel).toBe(true);
    expect(offersOf(doing({}, { state: "fitted" })).fitNow).toBe("");
  });

  it("of a dry run is never offered to be applied", () => {
    expect(offersOf(doing({}, { state: "fitted" })).apply).toBe(true);
    expect(offersOf(doing({}, { state: "fitted", dry_run: true })).apply).toBe(false);
  });

  it("says in words that the link is lost", () => {
    expect(instructionOf(doing({}, { state: "paused" }))).toMatchObject({
      key: "cal.do.paused",
      severity: "caution",
    });
  });

  it("names the face to take and the face to hold", () => {
    const next = instructionOf(doing({ instruction: "put-face", face_next: "nose-up" }));
    expect(next).toMatchObject({ key: "cal.do.put-face", face: "nose-up" });
    const hold = instructionOf(doing({ instruction: "hold-still", face_now: "level", phase: "hold-still" }));
    expect(hold).toMatchObject({ key: "cal.do.hold-face", face: "level" });
  });

  it("is found by the address, else the one that runs", () => {
    const old = { ...JOB, id: "j0", active: false, state: "applied" as const };
    expect(jobOf([JOB, old], "mag_ellipsoid", "j0")).toBe(old);
    expect(jobOf([JOB, old], "mag_ellipsoid", undefined)).toBe(JOB);
    expect(jobOf([old], "mag_ellipsoid", undefined)).toBeNull();
    expect(jobOf([JOB], "gyro_bias", undefined)).toBeNull();
  });

  it("tells how far its verification is only when that is a number", () => {
    const failure = { code: "too-few-poses", measured: 1, limit: 4, unit: "", advice: "" };
    expect(checkShare({ ...JOB, check_failure: failure })).toBe(0.25);
    expect(checkShare({ ...JOB, check_failure: { ...failure, measured: null } })).toBeNull();
    expect(checkShare(JOB)).toBeNull();
  });

  it("comes before the set in force on its sensor's card", () => {
    expect(cardState(null, JOB)).toBe("running");
    expect(cardState(null, null)).toBe("none");
  });
});

describe("directions that point down", () => {
  it.each([
    [[0, 0, 1], ["belly-down"]],
    [[-1, 0, 0], ["nose-up"]],
    [
      [0.8, 0.6, 0.05],
      ["nose-down", "right-down"],
    ],
    [
      [0, -0.5, -0.9],
      ["upside-down", "left-down"],
    ],
    [[], []],
  ])("are said by their weightiest parts", (down, parts) => {
    expect(poseParts(down)).toEqual(parts);
  });
});

describe("numbers of a calibration", () => {
  it("are in the units of people", () => {
    expect(
      numberRows(
        "gyro",
        { bias: [Math.PI / 180, 0, 0], scale: [1.01, 1, 1] },
        { bias: [Math.PI / 1800, 0, 0] },
      )[0],
    ).toMatchObject({
      name: "bias",
      axis: "x",
      unit: "°/s",
      value: expect.closeTo(1, 9) as number,
      sigma: expect.closeTo(0.1, 9) as number,
    });
    expect(numberRows("mag", { offset: [0.1, 0, 0] })[0]).toMatchObject({ value: 10, unit: "µT" });
    expect(numberRows("airspeed", { bias: 12 })).toMatchObject([{ axis: "", value: 12, unit: "Pa" }]);
  });

  it("of a mounting are its angles", () => {
    const [roll, pitch] = [0.05, -0.03];
    const [cr, sr, cp, sp] = [Math.cos(roll), Math.sin(roll), Math.cos(pitch), Math.sin(pitch)];
    const matrix = [
      [cp, sp * sr, sp * cr],
      [0, cr, -sr],
      [-sp, cp * sr, cp * cr],
    ];
    const rows = numberRows("board", { matrix });
    expect(rows.map((row) => row.value)).toEqual([
      expect.closeTo((roll * 180) / Math.PI, 9),
      expect.closeTo((pitch * 180) / Math.PI, 9),
      expect.closeTo(0, 9),
    ]);
  });

  it("stand beside the present ones, crossing terms only where there are some", () => {
    const eye = [
      [1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ];
    const now = {
      offset: [0.2, 0, 0],
      matrix: [
        [1.02, 0.01, 0],
        [0.01, 1, 0],
        [0, 0, 1],
      ],
    };
    const rows = pairRows("accel", now, {}, { offset: [0, 0, 0], matrix: eye });
    expect(rows.map((row) => `${row.name}${row.axis}`)).toEqual([
      "offsetx",
      "offsety",
      "offsetz",
      "scalex",
      "scaley",
      "scalez",
      "crossxy",
      "crossyx",
    ]);
    expect(rows[3]).toMatchObject({ before: 1, value: 1.02 });
  });

  it("are compared with their change in σ", () => {
    const change = { name: "offset[1]", old: 0.1, new: 0.3, change: 0.2, change_in_sigma: 4 };
    expect(diffRows("mag", [change], undefined, undefined)).toMatchObject([
      { name: "offset", axis: "y", unit: "µT", change: expect.closeTo(20, 9) as number, inSigma: 4 },
    ]);
    const none = { name: "matrix[0][2]", old: 0, new: 0, change: 0, change_in_sigma: null };
    expect(diffRows("accel", [none], undefined, undefined)).toEqual([]);
  });

  it.each([
    [Math.PI / 180, "rad/s", "1.00", "°/s"],
    [0.005, "gauss", "0.500", "µT"],
    [3, "", "3", ""],
    [123.4, "Pa", "123", "Pa"],
    [NaN, "m", "–", ""],
  ])("%f %s is said as %s %s", (value, unit, text, shown) => {
    expect(forPeople(value, unit)).toEqual([text, shown]);
  });

  it("take their unit from their name", () => {
    expect(namedNumber("still_s", 2.5)).toEqual(["still", "2.50", "s"]);
    expect(namedNumber("turned_x_rad", Math.PI)).toEqual(["turned_x", "180", "°"]);
    expect(namedNumber("turns_found", 1)).toEqual(["turns_found", "1", ""]);
  });

  it("say an improvement only when there is one in the same unit", () => {
    expect(improvement({ value: 2, unit: "m" }, { value: 0.5, unit: "m" })).toBe("4.0×");
    expect(improvement({ value: 2, unit: "m" }, { value: 2, unit: "m" })).toBe("");
    expect(improvement({ value: 2, unit: "m" }, { value: 0.5, unit: "Pa" })).toBe("");
  });
});

describe("options", () => {
  const none: Choices = {
    axis: "",
    turns: "",
    parameters: 9,
    heading: "",
    headingSigma: "",
    height: "",
    strength: "",
  };

  it("hold only what the kind understands", () => {
    expect(optionsOf("gyro_bias", { ...none, height: "5", axis: "x" })).toMatchObject({
      ok: true,
      options: {},
    });
    expect(optionsOf("gyro_scale", { ...none, axis: "x", turns: "3" }).options).toEqual({
      axis: "x",
      turns: 3,
    });
    expect(optionsOf("mag_ellipsoid", { ...none, parameters: 6 }).options).toEqual({
      ellipsoid_parameters: 6,
    });
    expect(optionsOf("baro_reference", { ...none, height: "\u221212,5" }).options).toEqual({
      height_m: -12.5,
    });
  });

  it("of a fixed heading need the heading", () => {
    expect(optionsOf("mag_fixed_heading", none)).toMatchObject({ ok: false, bad: { heading: [-360, 360] } });
    expect(optionsOf("mag_fixed_heading", { ...none, heading: "20" })).toMatchObject({
      ok: true,
      options: { heading_deg: 20 },
    });
  });

  it("are refused where they are no number or outside their limits", () => {
    expect(optionsOf("gyro_scale", { ...none, turns: "1.5" }).ok).toBe(false);
    expect(optionsOf("gyro_scale", { ...none, turns: "abc" }).ok).toBe(false);
    expect(optionsOf("mag_fixed_heading", { ...none, heading: "400" }).ok).toBe(false);
    expect(typed("1e3")).toBeNaN();
  });
});

describe("the demo board", () => {
  it("is asked for the face that the job wants, and for nothing while it lies so", () => {
    const job = doing(
      { face_next: "nose-up", pose_target_b: [-1, 0, 0] },
      { kind: "accel_six_position", sensor: "accel" },
    );
    expect(askedOf(job, job.kind, LYING)).toMatchObject({
      key: "demo.askedPose",
      command: { action: "pose", face: "nose-up" },
    });
    expect(askedOf(job, job.kind, { ...LYING, down_b: [-1, 0, 0] })).toBeNull();
    expect(askedOf(job, job.kind, { ...LYING, remaining_s: 1 })).toBeNull();
  });

  it("is laid level before what needs rest, taken out of its flight for it", () => {
    expect(askedOf(null, "gyro_bias", { ...LYING, mode: "flying" })).toMatchObject({
      key: "demo.askedLevel",
    });
    expect(askedOf(null, "gyro_bias", LYING)).toBeNull();
  });

  it("has the wind taken off its tube first", () => {
    const job = doing({}, { kind: "airspeed_zero", sensor: "airspeed" });
    expect(askedOf(job, job.kind, { ...LYING, is_wind_on_pitot: true })?.command).toEqual({
      action: "wind_on_pitot",
      is_on: false,
    });
  });

  it("is asked for nothing when no job runs", () => {
    expect(askedOf({ ...JOB, active: false, state: "fitted" }, null, LYING)).toBeNull();
  });

  it("belongs to a sensor each way it is calibrated", () => {
    expect(CAL_KINDS.map(sensorOf)).toContain("board");
  });
});

describe("stages of a chain", () => {
  it("stand behind their quantity's plot, last first", () => {
    const gyro = SENSOR_CHARTS.imu?.[0];
    const gnss = SENSOR_CHARTS.gnss?.[0];
    expect(gyro && chartStages(gyro).map((signal) => signal.id)).toEqual([
      "stages/gyro:filtered_x_rad_s",
      "stages/gyro:limited_x_rad_s",
      "stages/gyro:calibrated_x_rad_s",
    ]);
    expect(gnss && chartStages(gnss)).toEqual([]);
  });
});
