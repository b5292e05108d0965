import type { DelayOut } from "../api/wire";
import { DASH, fixed } from "./format";

/** An estimate whose σ is larger is not used yet; a test compares with the filter. */
export const USED_BELOW_S = 0.05;

/** How a delay is known: as the service says it, and whether an estimate is sure enough to be used. */
export type DelayOrigin = DelayOut["source"] | "unsure";

export function delayOrigin({ source, sigma_s }: DelayOut): DelayOrigin {
  return source === "estimated" && (sigma_s ?? Infinity) > USED_BELOW_S ? "unsure" : source;
}

/** Whole milliseconds; a dash when nobody knows. */
export function delayMs({ delay_s }: DelayOut): string {
  return fixed(delay_s === null ? null : delay_s * 1000, 0);
}

/** "± 4", "" for what was told. */
export function spreadMs({ sigma_s }: DelayOut): string {
  return sigma_s === null ? "" : `± ${fixed(sigma_s * 1000, 0)}`;
}

/** The delays of a sensor, as one text: "98" when one is told for all it measures, "112 ± 4 / 236 ± 6" otherwise. */
export function sensorDelayMs(delays: readonly DelayOut[], sensor: string): string {
  const texts = delays
    .filter(({ measurement }) => measurement.split("_")[0] === sensor)
    .map((each) => [delayMs(each), spreadMs(each)].filter(Boolean).join(" "));
  return [...new Set(texts)].join(" / ") || DASH;
}
