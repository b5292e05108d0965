import type { CalSensor, FailureOut, JobOut } from "../api/wire";
import { calibrateCodesZh } from "../i18n/calibrateCodes.zh";
import { speech, t, tMaybe } from "../i18n/index.svelte";
import { instructionOf, poseParts, type Face, type Instruction } from "../logic/calibrate";
import { forPeople } from "../logic/calibrateNumbers";
import { DASH } from "../logic/format";

export function calSensorName(sensor: CalSensor): string {
  return t(`cal.sensor.${sensor}`);
}

/** Sets that came from a file have kinds of their own. */
export function kindName(kind: string): string {
  return tMaybe(`cal.kind.${kind}`) ?? kind;
}

export function faceName(face: Face): string {
  return t(`cal.face.${face}`);
}

/** A direction that points down, as a hand holds it: "nose down and right side down". */
export function poseName(down: readonly number[]): string {
  return poseParts(down)
    .map((part) => t(`cal.pose.${part}`))
    .join(t("cal.pose.and"));
}

export function instructionText({ key, face, down }: Instruction): string {
  return tMaybe(key, { face: face ? faceName(face) : "", pose: poseName(down) }) ?? key;
}

export function jobInstruction(job: JobOut): string {
  return instructionText(instructionOf(job));
}

function quantity(value: number | null, unit: string): string {
  const [text, shown] = forPeople(value ?? NaN, unit);
  return shown && text !== DASH ? `${text}\u202f${shown}` : text;
}

/** Reasons whose limit is a least; of all others the limit is a most. */
const LEAST = new Set([
  "too-few-samples",
  "too-few-poses",
  "pose-missing",
  "coverage-poor",
  "coverage-planar",
  "not-turned",
  "motion",
]);

/** Why nothing was fitted: what happened and what to do, and the number that was too bad. */
export function failureText({ code, advice, measured, limit, unit }: FailureOut): {
  text: string;
  numbers: string;
} {
  const text = (speech.language === "zh" ? calibrateCodesZh[code] : undefined) ?? advice;
  if (measured === null || limit === null) return { text, numbers: "" };
  const filled = { measured: quantity(measured, unit), limit: quantity(limit, unit) };
  return {
    text,
    numbers: t(LEAST.has(code) && measured < limit ? "cal.measured" : "cal.measuredMost", filled),
  };
}
