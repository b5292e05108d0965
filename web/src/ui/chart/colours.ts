import type { Signal } from "../../logic/signals";
import { laneColour } from "../lanes";

/** Okabe and Ito without the colours of fixed meaning; by place within the plot. */
const SERIES = [
  "#268be6",
  "#e69f00",
  "#009e73",
  "#d55e00",
  "#9678d2",
  "#56b4e9",
  "#b5a92a",
  "#8c9aa8",
] as const;

/** One curve a lane: the lanes' own colours, as everywhere. Several of one lane: told apart by place. */
export function coloursOf(signals: readonly Signal[]): readonly string[] {
  const lanes = signals.map((each) => (each.group === "lane" ? each.source : ""));
  const oneEach = new Set(lanes).size === lanes.length;
  const reference = laneColour("reference");
  return signals.map((each, n) => {
    if (oneEach && each.group === "lane") return laneColour(each.source);
    if (each.source === "reference") return reference;
    return SERIES[n % SERIES.length] as string;
  });
}
