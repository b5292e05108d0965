import { onFrame } from "../../live/frames";
import type { Trace } from "../../live/trace";
import { timeWindow } from "./window.svelte";

/** A curve that has got nothing for this long says nothing about now. */
const QUIET_S = 2;

const watched = new Set<readonly Trace[]>();
let stop: (() => void) | undefined;

function follow(nowMs: number): void {
  let edgeS = -Infinity;
  for (const traces of watched) {
    for (const trace of traces) {
      if (trace.quietS(nowMs) < QUIET_S) edgeS = Math.max(edgeS, trace.edgeS(nowMs / 1000));
    }
  }
  if (Number.isFinite(edgeS)) timeWindow.edgeS = edgeS;
}

/** Let "now" of all plots follow these curves too, until the returned function is called. */
export function watchEdge(traces: readonly Trace[]): () => void {
  watched.add(traces);
  stop ??= onFrame(follow);
  return () => {
    watched.delete(traces);
    if (watched.size > 0) return;
    stop?.();
    stop = undefined;
  };
}
