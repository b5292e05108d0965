import type { CalKind, JobOut, SimulatorIn, SimulatorOut } from "../api/wire";
import { faceOf, type Face } from "./calibrate";

/** What a calibration asks for now, as a command to the demo board. */
export interface Asked {
  readonly key:
    "demo.askedPose" | "demo.askedLevel" | "demo.askedTurn" | "demo.askedSpin" | "demo.askedCover";
  readonly command: SimulatorIn;
  readonly face: Face | null;
  readonly down: readonly number[];
}

const LEVEL: Asked = {
  key: "demo.askedLevel",
  command: { action: "pose", face: "level" },
  face: null,
  down: [],
};
/** Down directions of three poses for a verification that leaves the choice: none is a face of the others. */
const CHECK_POSES = [
  [0, 0.6, 0.8],
  [0.8, 0, 0.6],
  [-0.7, -0.7, 0.2],
] as const;

function pose(down: readonly number[], face: Face | null = null): Asked {
  const command: SimulatorIn = face ? { action: "pose", face } : { action: "pose", down_b: down };
  return { key: "demo.askedPose", command, face, down };
}

/** The pose for a verification that the board is furthest from. */
function freshPose(doing: SimulatorOut): Asked {
  const at = CHECK_POSES.findIndex((each) => cosine(each, doing.down_b) > 0.98);
  return pose(CHECK_POSES[(at + 1) % CHECK_POSES.length] ?? CHECK_POSES[0]);
}

function cosine(a: readonly number[], b: readonly number[]): number {
  const dot = a.reduce((sum, value, i) => sum + value * (b[i] ?? 0), 0);
  return dot / (Math.hypot(...a) * Math.hypot(...b) || 1);
}

/** Null = nothing to do: no job, or the board is about it, or lies as it shall. */
export function askedOf(job: JobOut | null, kind: CalKind | null, doing: SimulatorOut | null): Asked | null {
  const wanted = job?.kind ?? kind;
  if (!doing || !wanted || (job && !job.active)) return null;
  if (doing.remaining_s > 0) return null;
  const lies = doing.mode === "in-hand" && cosine([0, 0, 1], doing.down_b) > 0.999;
  switch (wanted) {
    case "accel_six_position":
    case "accel_multi_pose":
      return job ? posed(job, doing) : lies ? null : LEVEL;
    case "mag_ellipsoid":
      if (!job) return null;
      return { key: "demo.askedSpin", command: { action: "spin" }, face: null, down: [] };
    case "gyro_scale":
      return turned(job, lies);
    case "airspeed_zero":
      if (doing.is_wind_on_pitot)
        return { ...LEVEL, key: "demo.askedCover", command: { action: "wind_on_pitot", is_on: false } };
      return lies ? null : LEVEL;
    case "mag_in_flight":
      return null;
    default:
      return lies ? null : LEVEL;
  }
}

function posed(job: JobOut, doing: SimulatorOut): Asked | null {
  if (job.state === "verifying") return freshPose(doing);
  const face = faceOf(job.progress.face_next);
  const down = job.progress.pose_target_b;
  if (down.length !== 3 || cosine(down, doing.down_b) > 0.999) return null; // it lies so: hold it
  return pose(down, face);
}

function turned(job: JobOut | null, lies: boolean): Asked | null {
  if (!job) return lies ? null : LEVEL;
  if (job.progress.is_complete && job.state !== "verifying") return null;
  const axis = "z";
  return { key: "demo.askedTurn", command: { action: "turntable", axis, turns: 2 }, face: null, down: [] };
}
