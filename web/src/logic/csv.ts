import type { Curve } from "../live/trace";
import { indexAt } from "../live/trace";

export interface CsvColumn {
  readonly name: string;
  readonly curve: Curve;
}

function quoted(text: string): string {
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/**
 * Curves between two times as CSV: one row per time any of them has, empty where one has none. Values as they are held,
 * to the last digit; times to the nanosecond of the board's clock.
 */
export function csvOf(columns: readonly CsvColumn[], fromS: number, toS: number): string {
  const at = columns.map(({ curve }) => indexAt(curve.tS, fromS - 1e-9) + 1);
  const lines = [["t_s", ...columns.map(({ name }) => quoted(name))].join(",")];
  for (;;) {
    const tS = Math.min(...columns.map(({ curve }, k) => curve.tS[at[k] as number] ?? Infinity));
    if (!(tS <= toS)) break;
    const cells = columns.map(({ curve }, k) => {
      const i = at[k] as number;
      if (curve.tS[i] !== tS) return "";
      at[k] = i + 1;
      const value = curve.values[i] as number;
      return Number.isFinite(value) ? String(value) : "";
    });
    lines.push([tS.toFixed(9), ...cells].join(","));
  }
  return lines.join("\n") + "\n";
}
