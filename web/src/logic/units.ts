/** How a column is shown: its quantity without the unit, the unit for people, and the factor to it. */
export interface Shown {
  readonly quantity: string;
  readonly unit: string;
  readonly factor: number;
}

const RAD_TO_DEG = 180 / Math.PI;

/** Longest suffix first. Degrees exist only here, on the screen. */
const SUFFIXES: readonly (readonly [string, string, number])[] = [
  ["_rad_s", "°/s", RAD_TO_DEG],
  ["_m_s2", "m/s²", 1],
  ["_m_s", "m/s", 1],
  ["_gauss", "µT", 100],
  ["_degc", "°C", 1],
  ["_rad", "°", RAD_TO_DEG],
  ["_deg", "°", 1],
  ["_pa", "hPa", 0.01],
  ["_hz", "Hz", 1],
  ["_ns", "s", 1e-9],
  ["_m", "m", 1],
  ["_s", "s", 1],
];

export function shown(column: string): Shown {
  for (const [suffix, unit, factor] of SUFFIXES) {
    if (column.endsWith(suffix)) return { quantity: column.slice(0, -suffix.length), unit, factor };
  }
  return { quantity: column, unit: "", factor: 1 };
}
