import { DEG } from "./angles";

const A_M = 6378137;
const E2 = 6.69437999014e-3;

/** Metres north and east from one WGS-84 point to a near one (curvature radii of the first; good to 1e-5 within 10 km). */
export function metresBetween(
  latDeg: number,
  lonDeg: number,
  toLatDeg: number,
  toLonDeg: number,
): { northM: number; eastM: number } {
  const s = Math.sin(latDeg / DEG);
  const k = 1 - E2 * s * s;
  const meridianM = (A_M * (1 - E2)) / (k * Math.sqrt(k));
  const normalM = A_M / Math.sqrt(k);
  const dLonDeg = ((toLonDeg - lonDeg + 540) % 360) - 180;
  return {
    northM: ((toLatDeg - latDeg) / DEG) * meridianM,
    eastM: (dLonDeg / DEG) * normalM * Math.cos(latDeg / DEG),
  };
}

/** "47.397742° N": seven digits are one centimetre, which is what the estimator resolves. */
export function formatLatitude(latDeg: number): string {
  return Number.isFinite(latDeg) ? `${Math.abs(latDeg).toFixed(7)}° ${latDeg < 0 ? "S" : "N"}` : "–";
}

export function formatLongitude(lonDeg: number): string {
  return Number.isFinite(lonDeg) ? `${Math.abs(lonDeg).toFixed(7)}° ${lonDeg < 0 ? "W" : "E"}` : "–";
}
