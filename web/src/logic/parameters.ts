import type { ParameterOut } from "../api/wire";

const RAD_TO_DEG = 180 / Math.PI;

/** The unit for people and the factor to it: degrees and microtesla exist only on the screen. */
export function shownUnit(unit: string): { unit: string; factor: number } {
  if (/^rad(?![a-z])/.test(unit)) return { unit: unit.replace("rad", "°"), factor: RAD_TO_DEG };
  if (unit === "gauss") return { unit: "µT", factor: 100 };
  return { unit, factor: 1 };
}

/** A setting as a person would write it: six significant digits, no trailing zeros. */
export function written(value: number | null, { unit }: ParameterOut): string {
  if (value === null) return "";
  const shown = Number((value * shownUnit(unit).factor).toPrecision(6));
  return String(shown);
}

/** For limits and defaults, which are read and not edited: four significant digits. */
export function told(value: number, { unit }: ParameterOut): string {
  const shown = Number((value * shownUnit(unit).factor).toPrecision(4));
  const size = Math.abs(shown);
  const text = size !== 0 && (size < 1e-3 || size >= 1e5) ? shown.toExponential() : String(shown);
  return text.replace("e+", "e").replaceAll("-", "\u2212");
}

export type Read =
  | { readonly ok: true; readonly value: number | null }
  | { readonly ok: false; readonly why: "number" | "range" };

/** What a person typed, in the service's unit; empty = the default. A decimal comma is taken for a point. */
export function readSetting(text: string, parameter: ParameterOut): Read {
  const trimmed = text
    .trim()
    .replaceAll("\u2212", "-")
    .replace(/^([^.,]*),([^.,]*)$/, "$1.$2");
  if (trimmed === "") return { ok: true, value: null };
  const typed = /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(trimmed) ? Number(trimmed) : NaN;
  if (!Number.isFinite(typed)) return { ok: false, why: "number" };
  const { factor } = shownUnit(parameter.unit);
  const value = factor === 1 ? typed : snapped(typed / factor, parameter);
  const inside = value >= parameter.minimum && value <= parameter.maximum;
  return inside ? { ok: true, value } : { ok: false, why: "range" };
}

/** A limit or the default as it was shown means exactly that, not what the rounded text divides to. */
function snapped(value: number, { minimum, maximum, default: own }: ParameterOut): number {
  const same = [minimum, maximum, own].find(
    (each) => each !== null && Math.abs(value - each) <= 6e-4 * Math.abs(each),
  );
  return same ?? value;
}

/** Whether a person has set it to something else than its default. */
export function isChanged({ value, default: own }: ParameterOut): boolean {
  return value !== own;
}

/** Settings that are a yes or a no, told to the service as 1 and 0. */
export function isSwitch({ unit, minimum, maximum, meaning }: ParameterOut): boolean {
  return unit === "" && minimum === 0 && maximum === 1 && /^(Past 0\.5|1: )/.test(meaning);
}
