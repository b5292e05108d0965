import type { Trace } from "../../live/trace";
import { timeWindow } from "./window.svelte";

/** Hold the curves still while the plots are paused, wherever that was asked for; for an effect. */
export function followPause(traces: readonly Trace[]): void {
  for (const trace of traces) {
    if (timeWindow.paused) trace.freeze();
    else trace.thaw();
  }
}
