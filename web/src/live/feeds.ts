import { api } from "../api/http";
import { Playhead } from "../logic/interpolate";
import { Ring } from "./ring";
import { decodeRows, type Rows } from "./rows";
import type { Stream } from "./socket";

/** Ten minutes at the rate at which the page watches. */
export const KEEP_S = 600;

/** Rows for each moment of topics whose attitude and position come in rows of their own. */
const TURNS = 2;

function rowsPerMoment(topic: string): number {
  return /(lanes|raw)\/(onboard|reference)$/.test(topic) ? TURNS : 1;
}

/** Rows of one topic as the page holds them, shared by everything that draws them. */
export class Feed {
  ring: Ring;
  readonly topic: string;
  readonly rateHz: number;
  readonly playhead = new Playhead();
  /** Host time of the last arrival, ms; −∞ before the first. */
  arrivedMs = -Infinity;
  /** Why there is nothing, when the service said so. */
  refusal = "";
  private readonly stop: () => void;

  constructor(stream: Stream, topic: string, columns: readonly string[], rateHz: number) {
    this.topic = topic;
    this.rateHz = rateHz;
    this.ring = new Ring(columns, Math.ceil(KEEP_S * rateHz * rowsPerMoment(topic)));
    const [wireTopic = "", part] = topic.split("#");
    const ours = (rows: Rows): Rows => (part === undefined ? rows : rowsWithFirst(rows, Number(part)));
    this.stop = stream.subscribe(wireTopic, rateHz, {
      rows: (rows) => this.received(ours(rows)),
      subscribed: (named) => {
        this.refusal = "";
        if (named && named.join() !== this.ring.columns.join())
          this.ring = new Ring(named, this.ring.capacity);
        void this.fetchHistory(wireTopic, ours);
      },
      refused: (problem) => (this.refusal = problem.detail),
    });
  }

  /** What happened before this page looked, or while it was cut off. */
  private async fetchHistory(wireTopic: string, ours: (rows: Rows) => Rows): Promise<void> {
    const [, boardId = "", ...name] = wireTopic.split("/");
    const answer = await api.history(boardId, name.join("/"), KEEP_S).catch(() => null);
    const rows = answer && decodeRows(answer);
    if (rows) this.ring.fill(ours(rows));
  }

  private received(rows: Rows): void {
    if (rows.nRows === 0) return;
    if (rows.bootId !== this.ring.bootId) this.playhead.reset();
    this.ring.append(rows);
    this.arrivedMs = performance.now();
    this.playhead.arrived(this.ring.newestS, rows.nRows, this.arrivedMs / 1000);
  }

  /** Seconds since the last row arrived; Infinity before the first. */
  ageS(nowMs: number): number {
    return (nowMs - this.arrivedMs) / 1000;
  }

  close(): void {
    this.stop();
  }
}

/** Keep the rows whose first column has this value: one aid out of the table of all. */
export function rowsWithFirst(rows: Rows, value: number): Rows {
  const kept = Array.from(rows.tNs.keys()).filter((row) => rows.data[row * rows.nCols] === value);
  const data = new Float64Array(kept.length * rows.nCols);
  kept.forEach((row, k) =>
    data.set(rows.data.subarray(row * rows.nCols, (row + 1) * rows.nCols), k * rows.nCols),
  );
  return { ...rows, nRows: kept.length, tNs: Float64Array.from(kept, (row) => rows.tNs[row] ?? NaN), data };
}

/** Hands out one shared `Feed` per topic and rate; keeps it a little after the last user left, for going back. */
export class Feeds {
  private readonly stream: Stream;
  private readonly held = new Map<
    string,
    { feed: Feed; users: number; timer?: ReturnType<typeof setTimeout> }
  >();
  private static readonly lingerMs = 60_000;

  constructor(stream: Stream) {
    this.stream = stream;
  }

  acquire(topic: string, columns: readonly string[], rateHz: number): { feed: Feed; release: () => void } {
    const key = `${topic}@${rateHz}`;
    let entry = this.held.get(key);
    if (!entry) {
      entry = { feed: new Feed(this.stream, topic, columns, rateHz), users: 0 };
      this.held.set(key, entry);
    }
    clearTimeout(entry.timer);
    entry.users++;
    const { feed } = entry;
    let held: typeof entry | null = entry;
    const release = (): void => {
      if (held && --held.users === 0) held.timer = setTimeout(() => this.drop(key), Feeds.lingerMs);
      held = null;
    };
    return { feed, release };
  }

  private drop(key: string): void {
    this.held.get(key)?.feed.close();
    this.held.delete(key);
  }
}
