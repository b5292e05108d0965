import type { Ring } from "../live/ring";
import type { Quat } from "./angles";
import { metresBetween } from "./geodesy";

/** How far one lane is from another at the same board time; NaN = one of them does not know. */
export interface LaneDifference {
  readonly attitudeRad: number;
  readonly horizontalM: number;
  readonly heightM: number;
  readonly velocityMS: number;
}

/** Total angle between two orientations. */
export function angleBetween(a: Quat, b: Quat): number {
  const dot = Math.abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]);
  return Number.isNaN(dot) ? NaN : 2 * Math.acos(Math.min(1, dot));
}

function quat(ring: Ring, i: number): Quat {
  return [ring.value(i, "q_w"), ring.value(i, "q_x"), ring.value(i, "q_y"), ring.value(i, "q_z")];
}

/** Compare at the newest moment both have reached; each at its row just before that. */
export function laneDifference(ring: Ring, chosen: Ring): LaneDifference {
  const tS = Math.min(ring.newestS, chosen.newestS);
  const [i, j] = [ring.indexAt(tS), chosen.indexAt(tS)];
  const d = (name: string): number => ring.value(i, name) - chosen.value(j, name);
  const { northM, eastM } = metresBetween(
    chosen.value(j, "lat_deg"),
    chosen.value(j, "lon_deg"),
    ring.value(i, "lat_deg"),
    ring.value(i, "lon_deg"),
  );
  return {
    attitudeRad: angleBetween(quat(ring, i), quat(chosen, j)),
    horizontalM: Math.hypot(northM, eastM),
    heightM: d("alt_m"),
    velocityMS: Math.hypot(d("vel_n_m_s"), d("vel_e_m_s"), d("vel_d_m_s")),
  };
}
