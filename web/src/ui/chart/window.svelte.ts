import { KEEP_S } from "../../live/feeds";

const SHORTEST_S = 0.5;
const LONGEST_S = KEEP_S;

/** The stretch of time all plots show: the last seconds up to now, or a fixed piece. Shared by every plot. */
class TimeWindow {
  spanS = $state(30);
  /** End of the piece, board time; null = now. */
  endS = $state<number | null>(null);
  paused = $state(false);
  /** Time under the pointer of whichever plot it is on; NaN = none. */
  cursorS = NaN;
  /** Moving end of "now", kept by the drawing loop. */
  edgeS = NaN;

  get toS(): number {
    return this.endS ?? this.edgeS;
  }

  /** Zoom about a moment that stays where it is on the screen; the end stays now while it is now. */
  zoom(factor: number, aboutS: number): void {
    const spanS = Math.min(LONGEST_S, Math.max(SHORTEST_S, this.spanS * factor));
    if (this.endS !== null) this.endS = aboutS + (this.endS - aboutS) * (spanS / this.spanS);
    this.spanS = spanS;
  }

  /** Move towards older (negative) or newer; reaching now follows it again. */
  pan(byS: number): void {
    const endS = this.toS + byS;
    if (!Number.isFinite(endS)) return;
    this.endS = endS >= this.edgeS && !this.paused ? null : Math.min(endS, this.edgeS);
  }

  now(): void {
    this.paused = false;
    this.endS = null;
  }

  togglePause(): void {
    if (this.paused) this.now();
    else {
      this.paused = true;
      this.endS = this.toS;
    }
  }
}

export const timeWindow = new TimeWindow();
