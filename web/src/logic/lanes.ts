import type { LaneChoiceOut, LaneOut, Severity } from "../api/wire";
import { laneSeverity } from "./health";

export type Provides = LaneChoiceOut["provides"];

/** Lanes that repeat what someone else computed: a good yardstick, never the state that is navigated by unasked. */
const REPEATERS = new Set(["onboard", "reference"]);

/** How often the rows of a lane are wanted where many are compared: every second navigation step. */
export const COMPARE_RATE_HZ = 25;

/** What can be read of a lane and compared, with the kinds of lane that know it. */
export const LANE_QUANTITIES = [
  "roll",
  "pitch",
  "heading",
  "height",
  "speed",
  "vel_n_m_s",
  "vel_e_m_s",
  "vel_d_m_s",
  "pos_n_m",
  "pos_e_m",
] as const;
export type LaneQuantity = (typeof LANE_QUANTITIES)[number];

const ATTITUDE = new Set<LaneQuantity>(["roll", "pitch", "heading"]);
const VERTICAL = new Set<LaneQuantity>(["height", "vel_d_m_s"]);

export function knows(provides: Provides, quantity: LaneQuantity): boolean {
  if (provides === "full") return true;
  return (provides === "attitude" ? ATTITUDE : VERTICAL).has(quantity);
}

/** The choice with a lane switched on; it joins at the end, so the main one stays. */
export function switchedOn(chosen: readonly string[], lane: string): string[] {
  return [...chosen.filter((each) => each !== lane), lane];
}

/** The choice without a lane; when it was the main one, the first full estimator left takes its place. */
export function switchedOff(
  chosen: readonly string[],
  lane: string,
  providesOf: (lane: string) => Provides,
): string[] {
  const left = chosen.filter((each) => each !== lane);
  if (chosen[0] !== lane) return left;
  const heir = left.find((each) => providesOf(each) === "full" && !REPEATERS.has(each));
  return heir === undefined ? left : asMain(left, heir);
}

/** The choice with this lane first, which makes it the main one. */
export function asMain(chosen: readonly string[], lane: string): string[] {
  return [lane, ...chosen.filter((each) => each !== lane)];
}

export type LaneState = "off" | "aside" | "starting" | LaneOut["status"];

/** What a lane does now, in one word: its own status while it runs. */
export function laneState(choice: LaneChoiceOut, live: LaneOut | undefined): LaneState {
  if (!choice.chosen) return "off";
  if (choice.failure || live?.failure) return "aside";
  return live?.status ?? choice.status ?? "starting";
}

/** Lanes that run, main one first: those worth a row, a curve and a subscription. */
export function runningLanes(choices: readonly LaneChoiceOut[], chosen: readonly string[]): LaneChoiceOut[] {
  return chosen.flatMap((name) => choices.find((each) => each.name === name && each.running) ?? []);
}

/** With what the others are compared: what the person picked, while it runs; else the main lane. */
export function yardstickOf(picked: string, running: readonly LaneChoiceOut[]): string {
  return running.some((each) => each.name === picked) ? picked : (running[0]?.name ?? "");
}

/** Shape beside a lane's state. */
export function laneShape(state: LaneState, provides: Provides): Severity | "none" {
  if (state === "off") return "none";
  if (state === "aside") return "warning";
  if (state === "starting") return "info";
  return laneSeverity({ status: state, provides });
}
