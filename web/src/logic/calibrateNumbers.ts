import type { CalSensor, FitOut, ResidualOut } from "../api/wire";
import { DEG } from "./angles";
import { DASH, fixed } from "./format";

export type Parameters = FitOut["parameters"];

/** One number of a calibration in the unit for people. */
export interface NumberRow {
  /** "offset", "bias", "scale", "cross", "roll", "pitch", "yaw": a key of the catalogue. */
  readonly name: string;
  /** "x", "xy"; "" = it has none. */
  readonly axis: string;
  readonly value: number;
  /** One standard deviation; NaN = not measured. */
  readonly sigma: number;
  readonly unit: string;
}

const AXES = ["x", "y", "z"] as const;
const UNIT_OF: Readonly<Record<CalSensor, readonly [unit: string, factor: number]>> = {
  gyro: ["°/s", DEG],
  accel: ["m/s²", 1],
  mag: ["µT", 100],
  board: ["°", DEG],
  airspeed: ["Pa", 1],
  baro: ["m", 1],
};

function vector(value: unknown): readonly number[] {
  if (typeof value === "number") return [value];
  return Array.isArray(value) ? value.map((each) => (typeof each === "number" ? each : NaN)) : [];
}

function matrix(value: unknown): readonly (readonly number[])[] {
  return Array.isArray(value) && value.every(Array.isArray) ? value.map(vector) : [];
}

/** Every number of a calibration: offsets in the sensor's unit, the matrix as scales and what crosses between axes. */
export function numberRows(sensor: CalSensor, parameters: Parameters, sigma: Parameters = {}): NumberRow[] {
  if (sensor === "board") return levelRows(matrix(parameters["matrix"]), matrix(sigma["matrix"]));
  const [unit, factor] = UNIT_OF[sensor];
  const rows: NumberRow[] = [];
  for (const name of ["offset", "bias"]) {
    const values = vector(parameters[name]);
    const sigmas = vector(sigma[name]);
    values.forEach((value, i) =>
      rows.push({
        name,
        axis: values.length === 3 ? (AXES[i] ?? "") : "",
        value: value * factor,
        sigma: (sigmas[i] ?? NaN) * factor,
        unit,
      }),
    );
  }
  const scale = vector(parameters["scale"]);
  scale.forEach((value, i) =>
    rows.push({
      name: "scale",
      axis: AXES[i] ?? "",
      value,
      sigma: vector(sigma["scale"])[i] ?? NaN,
      unit: "",
    }),
  );
  return [...rows, ...matrixRows(matrix(parameters["matrix"]), matrix(sigma["matrix"]))];
}

function matrixRows(
  values: readonly (readonly number[])[],
  sigmas: readonly (readonly number[])[],
): NumberRow[] {
  const rows: NumberRow[] = [];
  values.forEach((line, i) =>
    line.forEach((value, j) =>
      rows.push({
        name: i === j ? "scale" : "cross",
        axis: i === j ? (AXES[i] ?? "") : `${AXES[i]}${AXES[j]}`,
        value,
        sigma: sigmas[i]?.[j] ?? NaN,
        unit: "",
      }),
    ),
  );
  return rows.sort((a, b) => Number(a.name === "cross") - Number(b.name === "cross"));
}

/** A mounting as angles of the board in the vehicle: R = R_z(yaw) R_y(pitch) R_x(roll). */
function levelRows(r: readonly (readonly number[])[], s: readonly (readonly number[])[]): NumberRow[] {
  const at = (m: readonly (readonly number[])[], i: number, j: number): number => m[i]?.[j] ?? NaN;
  const angles = [
    ["roll", Math.atan2(at(r, 2, 1), at(r, 2, 2)), at(s, 2, 1)],
    ["pitch", Math.asin(Math.max(-1, Math.min(1, -at(r, 2, 0)))), at(s, 2, 0)],
    ["yaw", Math.atan2(at(r, 1, 0), at(r, 0, 0)), at(s, 1, 0)],
  ] as const;
  return angles.map(([name, angle, sigma]) => ({
    name,
    axis: "",
    value: angle * DEG,
    sigma: sigma * DEG,
    unit: "°",
  }));
}

/** Rows of a new calibration beside the same of the present one; crossing terms and yaw only where one side has some. */
export interface PairRow extends NumberRow {
  readonly before: number;
}

export function pairRows(
  sensor: CalSensor,
  now: Parameters,
  sigma: Parameters,
  before: Parameters | undefined,
): PairRow[] {
  const old = new Map(numberRows(sensor, before ?? {}).map((row) => [`${row.name}${row.axis}`, row.value]));
  return numberRows(sensor, now, sigma)
    .map((row) => ({ ...row, before: old.get(`${row.name}${row.axis}`) ?? NaN }))
    .filter(
      (row) => (row.name !== "cross" && row.name !== "yaw") || nonzero(row.value) || nonzero(row.before),
    );
}

function nonzero(value: number): boolean {
  return Number.isFinite(value) && Math.abs(value) > 1e-9;
}

/** Decimals of a calibration's numbers: enough to see a change that matters, no more. */
export function decimalsOf(unit: string): number {
  return { "°/s": 3, "m/s²": 3, µT: 2, "°": 3, Pa: 1, m: 2 }[unit] ?? 4;
}

export function written(value: number, unit: string): string {
  return fixed(value, decimalsOf(unit));
}

/** A quantity of the service in the unit for people. */
export function forPeople(value: number, unit: string): readonly [text: string, unit: string] {
  if (!Number.isFinite(value)) return [DASH, ""];
  const [factor, shown] = (
    {
      "rad/s": [DEG, "°/s"],
      rad: [DEG, "°"],
      gauss: [100, "µT"],
    } as const
  )[unit] ?? [1, unit];
  const size = Math.abs(value * factor);
  const decimals =
    (unit === "" && Number.isInteger(value)) || size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3;
  return [fixed(value * factor, decimals), shown];
}

export function spokenResidual(residual: ResidualOut | null | undefined): string {
  if (residual?.value === null || residual?.value === undefined) return DASH;
  const [text, unit] = forPeople(residual.value, residual.unit);
  return unit ? `${text}\u202f${unit}` : text;
}

/** How much smaller a residual became, as "4.2×"; "" when it cannot be said. */
export function improvement(before: ResidualOut | null, after: ResidualOut | null): string {
  if (!before?.value || !after?.value || before.unit !== after.unit) return "";
  const factor = before.value / after.value;
  if (!Number.isFinite(factor) || factor < 1.05) return "";
  return `${factor >= 10 ? Math.round(factor) : factor.toFixed(1)}×`;
}

const SUFFIXES: readonly (readonly [suffix: string, unit: string])[] = [
  ["_rad_s", "rad/s"],
  ["_m_s2", "m/s²"],
  ["_gauss", "gauss"],
  ["_degc", "°C"],
  ["_deg", "°"],
  ["_rad", "rad"],
  ["_pa", "Pa"],
  ["_s", "s"],
  ["_m", "m"],
];

/** A number that the service names with its unit: "still_s" → "still", "3.2", "s". */
export function namedNumber(name: string, value: number | null): readonly [string, string, string] {
  const found = SUFFIXES.find(([suffix]) => name.endsWith(suffix));
  const stem = found ? name.slice(0, -found[0].length) : name;
  const [text, unit] = forPeople(value ?? NaN, found?.[1] ?? "");
  return [stem, text, unit];
}
