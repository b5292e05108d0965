import type { BoardOut, LaneOut, Severity } from "../api/wire";
import type { Connection } from "../live/socket";
import { DEG } from "./angles";
import { duration, spread } from "./format";
import { NO_DATA_AFTER_S } from "./stale";

export type SentenceKey =
  | "state.connecting"
  | "state.lost"
  | "state.lostNow"
  | "state.noBoard"
  | "state.boardFailed"
  | "state.boardEnded"
  | "state.waiting"
  | "state.noData"
  | "state.noEstimator"
  | "state.aligning"
  | "state.attitude"
  | "state.attitudeOnly"
  | "state.navigating"
  | "state.navigatingPlain"
  | "state.deadReckoning"
  | "state.deadReckoningPlain"
  | "state.failed";

/** The state of everything in one sentence: a catalogue key with its numbers, and how grave it is. */
export interface Sentence {
  readonly key: SentenceKey;
  readonly params: Readonly<Record<string, string>>;
  readonly severity: Severity;
}

export interface Situation {
  readonly connection: Connection;
  readonly nowMs: number;
  /** False until the first answer about boards. */
  readonly known: boolean;
  readonly board: BoardOut | null;
  /** Since the newest sample, now; null before the first. */
  readonly ageS: number | null;
}

/** Answer "is it alive, can I trust it?" in the order in which trouble shadows trouble. */
export function sentenceOf({ connection, nowMs, known, board, ageS }: Situation): Sentence {
  if (connection.phase === "waiting") return lost(connection.untilMs, nowMs);
  if (connection.phase === "connecting" && connection.again) return sentence("state.lostNow", "warning");
  if (connection.phase === "connecting" || !known) return sentence("state.connecting", "info");
  if (!board) return sentence("state.noBoard", "info");
  if (board.state === "failed") return sentence("state.boardFailed", "warning");
  if (board.state === "ended") return sentence("state.boardEnded", "info");
  if (ageS === null) return sentence("state.waiting", board.link.state === "open" ? "info" : "caution");
  if (ageS > NO_DATA_AFTER_S) return sentence("state.noData", "warning", { age: wholeSeconds(ageS) });
  const lane = board.lanes.find((each) => each.lane === board.main_lane);
  return lane ? laneSentence(lane) : sentence("state.noEstimator", "info");
}

function lost(untilMs: number, nowMs: number): Sentence {
  const waitS = Math.max(0, Math.ceil((untilMs - nowMs) / 1000));
  return sentence("state.lost", "warning", { wait: String(waitS) });
}

function laneSentence(lane: LaneOut): Sentence {
  const metres = lane.sigma_h_m === null ? null : spread(lane.sigma_h_m);
  if (lane.status === "aligning") return sentence("state.aligning", "info");
  if (lane.status === "failed") return sentence("state.failed", "warning");
  if (lane.status === "attitude") {
    if (lane.sigma_heading_rad === null) return sentence("state.attitudeOnly", "caution");
    return sentence("state.attitude", "caution", { deg: spread(lane.sigma_heading_rad * DEG) });
  }
  if (lane.status === "dead_reckoning") {
    const age = wholeSeconds(lane.dead_reckoning_s ?? 0);
    if (metres === null) return sentence("state.deadReckoningPlain", "caution", { age });
    return sentence("state.deadReckoning", "caution", { age, m: metres });
  }
  return metres === null
    ? sentence("state.navigatingPlain", "ok")
    : sentence("state.navigating", "ok", { m: metres });
}

function wholeSeconds(seconds: number): string {
  return seconds < 120 ? `${Math.round(seconds)} s` : duration(seconds);
}

function sentence(key: SentenceKey, severity: Severity, params: Record<string, string> = {}): Sentence {
  return { key, severity, params };
}
