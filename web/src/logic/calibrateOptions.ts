import type { CalibrationWish, CalKind } from "../api/wire";

/** What a person typed; "" = left out. */
export interface Choices {
  axis: "" | "x" | "y" | "z";
  turns: string;
  parameters: 6 | 9;
  heading: string;
  headingSigma: string;
  height: string;
  strength: string;
}

type Limits = readonly [low: number, high: number];
type Numeric = "turns" | "heading" | "headingSigma" | "height" | "strength";

/** As `server/wire_calibration.py` has them. */
const LIMITS: Readonly<Record<Numeric, Limits>> = {
  turns: [1, 1000],
  heading: [-360, 360],
  headingSigma: [0.1, 45],
  height: [-1000, 20000],
  strength: [0.1, 2],
};

const FIELDS: Readonly<Partial<Record<CalKind, readonly Numeric[]>>> = {
  gyro_scale: ["turns"],
  mag_ellipsoid: ["strength"],
  mag_fixed_heading: ["heading", "headingSigma"],
  baro_reference: ["height"],
};

const NAME = {
  turns: "turns",
  heading: "heading_deg",
  headingSigma: "heading_sigma_deg",
  height: "height_m",
  strength: "strength_gauss",
} as const;

export interface ReadOptions {
  readonly ok: boolean;
  readonly options: CalibrationWish["options"];
  /** Fields that hold no number within their limits. */
  readonly bad: Readonly<Partial<Record<keyof Choices, Limits>>>;
}

/** A number as people type it; NaN when it is none. */
export function typed(text: string): number {
  const plain = text.trim().replaceAll("\u2212", "-").replace(",", ".");
  return /^[-+]?(\d+\.?\d*|\.\d+)$/.test(plain) ? Number(plain) : NaN;
}

/** Only what this kind understands is told; a fixed heading is nothing without one. */
export function optionsOf(kind: CalKind, choices: Choices): ReadOptions {
  const options: Record<string, unknown> = {};
  const bad: Partial<Record<keyof Choices, Limits>> = {};
  for (const field of FIELDS[kind] ?? []) {
    const text = choices[field];
    if (text.trim() === "" && field !== "heading") continue;
    const value = typed(text);
    const [low, high] = LIMITS[field];
    if (value >= low && value <= high && (field !== "turns" || Number.isInteger(value)))
      options[NAME[field]] = value;
    else bad[field] = LIMITS[field];
  }
  if (kind === "gyro_scale" && choices.axis) options["axis"] = choices.axis;
  if (kind === "mag_ellipsoid") options["ellipsoid_parameters"] = choices.parameters;
  return { ok: Object.keys(bad).length === 0, options, bad };
}
