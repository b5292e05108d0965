import type { CalSensor, ChangeOut, SetOut } from "../api/wire";
import { numberRows } from "./calibrateNumbers";

/** One number of two sets in the unit for people. */
export interface DiffRow {
  readonly name: string;
  readonly axis: string;
  readonly unit: string;
  readonly old: number;
  readonly new: number;
  readonly change: number;
  /** NaN = the uncertainty is not known. */
  readonly inSigma: number;
}

const AXES = "xyz";

/** The service's names, "offset[0]" and "matrix[1][2]", as rows; a mounting is compared in angles. */
export function diffRows(
  sensor: CalSensor,
  changes: readonly ChangeOut[],
  from: SetOut | undefined,
  to: SetOut | undefined,
): DiffRow[] {
  if (sensor === "board") return angleRows(from, to);
  return changes
    .map((each) => rowOf(sensor, each))
    .filter((row) => row.name !== "cross" || row.old !== 0 || row.new !== 0);
}

function rowOf(sensor: CalSensor, { name, old, new: now, change, change_in_sigma }: ChangeOut): DiffRow {
  const [, stem = name, i = "", j = ""] = /^(\w+)(?:\[(\d)\])?(?:\[(\d)\])?$/.exec(name) ?? [];
  const axis = `${AXES[Number(i || "9")] ?? ""}${i !== j ? (AXES[Number(j || "9")] ?? "") : ""}`;
  const plain = stem === "matrix" ? (i === j ? "scale" : "cross") : stem;
  const { unit, factor } = unitOf(sensor, plain);
  return {
    name: plain,
    axis,
    unit,
    old: (old ?? NaN) * factor,
    new: (now ?? NaN) * factor,
    change: (change ?? NaN) * factor,
    inSigma: change_in_sigma ?? NaN,
  };
}

function unitOf(sensor: CalSensor, name: string): { unit: string; factor: number } {
  const [row] = name === "scale" || name === "cross" ? [] : numberRows(sensor, { [name]: 1 });
  return row ? { unit: row.unit, factor: row.value } : { unit: "", factor: 1 };
}

function angleRows(from: SetOut | undefined, to: SetOut | undefined): DiffRow[] {
  const sides = [from, to].map((set) => (set ? numberRows("board", set.parameters, set.sigma) : []));
  return (sides[0] ?? []).map((old, k) => {
    const now = sides[1]?.[k];
    const change = (now?.value ?? NaN) - old.value;
    const sigma = Math.hypot(...[old.sigma, now?.sigma ?? NaN].filter(Number.isFinite));
    return {
      name: old.name,
      axis: "",
      unit: old.unit,
      old: old.value,
      new: now?.value ?? NaN,
      change,
      inSigma: sigma > 0 ? change / sigma : NaN,
    };
  });
}
