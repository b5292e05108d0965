import type { Ring } from "../live/ring";
import { eulerFromQuat, slerp, type Quat } from "./angles";
import { between } from "./interpolate";

/** What people read of a lane at one moment; NaN = unknown. */
export interface NavState {
  readonly tS: number;
  readonly rollRad: number;
  readonly pitchRad: number;
  readonly yawRad: number;
  readonly velNMS: number;
  readonly velEMS: number;
  readonly velDMS: number;
  readonly speedMS: number;
  readonly climbMS: number;
  readonly posNM: number;
  readonly posEM: number;
  readonly heightM: number;
}

function quatAt(ring: Ring, i: number): Quat {
  return [ring.value(i, "q_w"), ring.value(i, "q_x"), ring.value(i, "q_y"), ring.value(i, "q_z")];
}

/** Return the state at tS between the two rows around it; before the first or after the last, that row itself. */
export function navStateAt(ring: Ring, tS: number): NavState {
  const last = ring.length - 1;
  const i = Math.min(Math.max(ring.indexAt(tS), 0), last);
  const j = Math.min(i + 1, last);
  const times = ring.times();
  const fraction = between(times[i] ?? NaN, times[j] ?? NaN, tS);
  const mix = (name: string): number => {
    const a = ring.value(i, name);
    return a + (ring.value(j, name) - a) * fraction;
  };
  const { rollRad, pitchRad, yawRad } = eulerFromQuat(slerp(quatAt(ring, i), quatAt(ring, j), fraction));
  const [velNMS, velEMS, velDMS] = [mix("vel_n_m_s"), mix("vel_e_m_s"), mix("vel_d_m_s")];
  return {
    tS,
    rollRad,
    pitchRad,
    yawRad,
    velNMS,
    velEMS,
    velDMS,
    speedMS: Math.hypot(velNMS, velEMS),
    climbMS: -velDMS,
    posNM: mix("pos_n_m"),
    posEM: mix("pos_e_m"),
    heightM: -mix("pos_d_m"),
  };
}
