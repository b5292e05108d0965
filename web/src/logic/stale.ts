/** A value older than this looks old. */
export const STALE_AFTER_S = 1;
/** After this long without a row the sentence says "No data". */
export const NO_DATA_AFTER_S = 2;

export type Freshness = "missing" | "fresh" | "stale";

export function freshness(ageS: number | null | undefined): Freshness {
  if (ageS === null || ageS === undefined || !Number.isFinite(ageS)) return "missing";
  return ageS > STALE_AFTER_S ? "stale" : "fresh";
}
