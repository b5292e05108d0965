import type { Signal } from "../../logic/signals";
import { laneColour, laneDash } from "../lanes";

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

/** Whether each curve is of a lane of its own, so that colour and pattern can say which. */
function oneEach(signals: readonly Signal[]): boolean {
  const lanes = signals.map((each) => (each.group === "lane" ? each.source : ""));
  return new Set(lanes).size === lanes.length;
}

/** One curve a lane: the lanes' own colours, as everywhere. Several of one lane: told apart by place. */
export function coloursOf(signals: readonly Signal[]): readonly string[] {
  const byLane = oneEach(signals);
  const reference = laneColour("reference");
  return signals.map((each, n) => {
    if (byLane && each.group === "lane") return laneColour(each.source);
    if (each.source === "reference") return reference;
    return SERIES[n % SERIES.length] as string;
  });
}

/** Dash patterns to the colours: a lane's own where its colour is. */
export function dashesOf(signals: readonly Signal[]): readonly (readonly number[])[] {
  const byLane = oneEach(signals);
  return signals.map((each) => (byLane && each.group === "lane" ? laneDash(each.source) : []));
}
