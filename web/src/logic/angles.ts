export const DEG = 180 / Math.PI;

export type Quat = readonly [w: number, x: number, y: number, z: number];

export interface Euler {
  readonly rollRad: number;
  readonly pitchRad: number;
  /** Clockwise from true north, in [0, 2π). */
  readonly yawRad: number;
}

/** Return ZYX angles of q_nb, [w, x, y, z], body FRD to local NED. */
export function eulerFromQuat([w, x, y, z]: Quat): Euler {
  const rollRad = Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y));
  const pitchRad = Math.asin(clamp(2 * (w * y - z * x), -1, 1));
  const yawRad = Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
  return { rollRad, pitchRad, yawRad: wrapTurn(yawRad) };
}

/** Return the rotation a fraction of the way from a to b, the short way round. */
export function slerp(a: Quat, b: Quat, fraction: number): Quat {
  let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  const sign = dot < 0 ? -1 : 1;
  dot = Math.min(1, Math.abs(dot));
  const angle = Math.acos(dot);
  const s = Math.sin(angle);
  const ka = s < 1e-6 ? 1 - fraction : Math.sin((1 - fraction) * angle) / s;
  const kb = sign * (s < 1e-6 ? fraction : Math.sin(fraction * angle) / s);
  const q = [0, 1, 2, 3].map((i) => ka * (a[i] as number) + kb * (b[i] as number));
  const norm = Math.hypot(...q) || 1;
  return q.map((value) => value / norm) as unknown as Quat;
}

export function clamp(value: number, low: number, high: number): number {
  return value < low ? low : value > high ? high : value;
}

/** Return the angle in [0, 2π). */
export function wrapTurn(angleRad: number): number {
  const turn = 2 * Math.PI;
  const wrapped = angleRad % turn;
  return wrapped < 0 ? wrapped + turn : wrapped;
}

/** Return the angle in degrees, an integer from 0 to 359, as a heading is spoken. */
export function headingDeg(yawRad: number): number {
  return Math.round(wrapTurn(yawRad) * DEG) % 360;
}
