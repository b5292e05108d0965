import type { CalKind, CalSensor, JobOut, SetOut, SetsOut } from "../api/wire";

/** Sensors in the order in which they are best calibrated: the level needs the accelerometer, the compass the level. */
export const CAL_SENSORS = [
  "gyro",
  "accel",
  "board",
  "mag",
  "airspeed",
  "baro",
] as const satisfies CalSensor[];

export const KINDS_OF: Readonly<Record<CalSensor, readonly CalKind[]>> = {
  gyro: ["gyro_bias", "gyro_scale"],
  accel: ["accel_six_position", "accel_multi_pose"],
  board: ["level"],
  mag: ["mag_ellipsoid", "mag_fixed_heading", "mag_in_flight"],
  airspeed: ["airspeed_zero"],
  baro: ["baro_reference"],
};

export const CAL_KINDS: readonly CalKind[] = CAL_SENSORS.flatMap((sensor) => KINDS_OF[sensor]);

/** The kind that a text of the address names. */
export function kindOf(text: string | undefined): CalKind | null {
  return CAL_KINDS.find((kind) => kind === text) ?? null;
}

export function sensorOf(kind: CalKind): CalSensor {
  return CAL_SENSORS.find((sensor) => KINDS_OF[sensor].includes(kind)) ?? "gyro";
}

/** As the service names them; `server/simulator.py` says which way they point. */
export const FACES = ["nose-up", "nose-down", "right-up", "left-up", "upside-down", "level"] as const;
export type Face = (typeof FACES)[number];

export function faceOf(text: string): Face | null {
  return FACES.find((face) => face === text) ?? null;
}

export const STEPS = ["prepare", "collect", "result", "apply"] as const;
export type Step = (typeof STEPS)[number];

/** Where a person stands with a job; none = about to start one. */
export function stepOf(job: JobOut | null): Step {
  switch (job?.state) {
    case undefined:
    case "cancelled":
      return "prepare";
    case "waiting":
    case "collecting":
    case "paused":
    case "fitting":
    case "refused":
      return "collect";
    case "applied":
      return "apply";
    default:
      return job?.set_id ? "apply" : "result";
  }
}

/** The one instruction of now, as a key of the catalogue and what is filled in. */
export interface Instruction {
  readonly key: string;
  readonly face: Face | null;
  /** Direction that shall point down, body FRD; [] = none. */
  readonly down: readonly number[];
  readonly severity: "" | "caution";
}

export function instructionOf(job: JobOut): Instruction {
  const { progress, state, kind } = job;
  const say = (key: string, more: Partial<Instruction> = {}): Instruction => ({
    key: `cal.do.${key}`,
    face: null,
    down: [],
    severity: "",
    ...more,
  });
  if (state === "waiting") return say("waiting");
  if (state === "paused") return say("paused", { severity: "caution" });
  if (state === "fitting") return say("fitting");
  if (state === "verifying") return { ...say(""), key: `cal.check.${kind}` };
  const face = faceOf(progress.face_next);
  const down = progress.pose_target_b;
  switch (progress.instruction) {
    case "put-face":
      return face ? say("put-face", { face }) : say("put-any-face");
    case "hold-still": {
      const now = faceOf(progress.face_now);
      if (now) return say("hold-face", { face: now });
      return say(progress.phase === "moving" ? "moving" : "hold-still");
    }
    case "put-any-pose":
      return down.length ? say("put-pose", { down }) : say("put-any-pose");
    case "rotate-all-ways":
      return down.length ? say("rotate-towards", { down }) : say("rotate-all-ways");
    case "turn-table":
    case "cover-pitot":
    case "done":
      return say(progress.instruction);
    default:
      return say("wait");
  }
}

/** Ways in which a direction that points down is said, weightiest first: "nose-down", "right-down". */
export const POSE_PARTS = [
  "nose-down",
  "nose-up",
  "right-down",
  "left-down",
  "belly-down",
  "upside-down",
] as const;
export type PosePart = (typeof POSE_PARTS)[number];
const PART_LEAST = 0.38; // 22°: less is not seen in the hand

export function poseParts(down: readonly number[]): PosePart[] {
  const length = Math.hypot(...down);
  if (!(length > 0)) return [];
  return down
    .map((value, axis) => ({
      size: Math.abs(value) / length,
      part: POSE_PARTS[2 * axis + (value < 0 ? 1 : 0)],
    }))
    .filter(({ size }) => size >= PART_LEAST)
    .sort((a, b) => b.size - a.size)
    .flatMap(({ part }) => part ?? []);
}

/** What a person may do with a job now; a button that is not offered is not shown. */
export interface Offers {
  readonly fitNow: "" | "secondary" | "primary";
  readonly cancel: boolean;
  readonly verify: boolean;
  readonly apply: boolean;
  readonly again: boolean;
  /** Forget a result that was not applied. */
  readonly discard: boolean;
}

export function offersOf(job: JobOut): Offers {
  const collects = job.state === "waiting" || job.state === "collecting" || job.state === "paused";
  const fitted = job.state === "fitted";
  return {
    fitNow: !collects ? "" : job.progress.is_enough ? "primary" : "secondary",
    cancel: collects || job.state === "fitting" || job.state === "verifying",
    verify: fitted || job.state === "applied",
    apply: fitted && !job.dry_run,
    again: fitted || job.state === "applied" || job.state === "refused" || job.state === "cancelled",
    discard: fitted,
  };
}

/** The job a wizard shows: the one that the address names, else what runs or waits to be applied. */
export function jobOf(jobs: readonly JobOut[], kind: CalKind, id: string | undefined): JobOut | null {
  if (id) return jobs.find((job) => job.id === id) ?? null;
  return jobs.find((job) => job.kind === kind && (job.active || job.state === "fitted")) ?? null;
}

/** The job that holds a sensor, of whatever kind. */
export function holderOf(jobs: readonly JobOut[], sensor: CalSensor): JobOut | null {
  return jobs.find((job) => job.active && job.sensor === sensor) ?? null;
}

export function inForce(sets: SetsOut | null, sensor: CalSensor): SetOut | null {
  return sets?.sets.find((each) => each.sensor === sensor && each.in_force) ?? null;
}

export function setsOf(sets: SetsOut | null, sensor: CalSensor): readonly SetOut[] {
  return sets?.sets.filter((each) => each.sensor === sensor) ?? [];
}

/** What a card says of its sensor, worst first. */
export type CardState = "running" | "result" | "none" | "poor" | "unverified" | "verified" | "failed";

export function cardState(set: SetOut | null, job: JobOut | null): CardState {
  if (job?.active) return "running";
  if (job?.state === "fitted") return "result";
  if (!set) return "none";
  if (set.check && !set.check.ok) return "failed";
  if (set.grade === "poor") return "poor";
  return set.check ? "verified" : "unverified";
}

/** How much of a verification's need is met, 0 to 1; null while that is not known. */
export function checkShare(job: JobOut): number | null {
  const { measured, limit } = job.check_failure ?? {};
  if (typeof measured !== "number" || typeof limit !== "number" || !(limit > 0)) return null;
  return Math.min(1, Math.max(0, measured / limit));
}
