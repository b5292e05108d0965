import type { Rows } from "../src/live/rows";

/** Rows as the decoder returns them. */
export function rowsOf(tS: readonly number[], rows: readonly (readonly number[])[], bootId = 0): Rows {
  const nCols = rows[0]?.length ?? 0;
  return {
    id: 1,
    bootId,
    nRows: tS.length,
    nCols,
    tNs: Float64Array.from(tS, (t) => t * 1e9),
    data: Float64Array.from(rows.flat()),
  };
}
