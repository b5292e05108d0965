/**
 * Which moment of board time to draw now, so that motion is smooth and never guessed.
 *
 * Rows arrive in bunches. The playhead follows host time at a fixed distance behind the earliest-arriving rows; the
 * distance is a little over one row interval, so there is nearly always a row on either side, and it never passes the
 * newest row received.
 */
export class Playhead {
  /** Host minus board time of the quickest row lately, s. */
  private offsetS = NaN;
  private intervalS = 0.05;
  private lastRowS = NaN;
  private shownS = NaN;

  reset(): void {
    this.offsetS = this.lastRowS = this.shownS = NaN;
  }

  /** Note the arrival of rows whose newest is valid at tS; nowS is host time of any fixed origin. */
  arrived(tS: number, rowCount: number, nowS: number): void {
    if (Number.isFinite(this.lastRowS) && tS > this.lastRowS) {
      const gapS = Math.min(tS - this.lastRowS, 1);
      this.intervalS += 0.1 * (gapS - this.intervalS);
    }
    const offsetS = nowS - tS;
    const jumped = Math.abs(offsetS - this.offsetS) > 1;
    if (!Number.isFinite(this.offsetS) || jumped || offsetS < this.offsetS) this.offsetS = offsetS;
    else this.offsetS += 0.005 * rowCount * (offsetS - this.offsetS);
    this.lastRowS = tS;
  }

  /** Board time to draw at host time nowS; NaN before the first row, never beyond the newest, never backwards. */
  at(nowS: number): number {
    if (!Number.isFinite(this.lastRowS)) return NaN;
    const wantedS = Math.min(nowS - this.offsetS - 1.25 * this.intervalS, this.lastRowS);
    const backS = this.shownS - wantedS;
    this.shownS = backS > 0 && backS < 1 ? this.shownS : wantedS;
    return this.shownS;
  }
}

/** Fraction of the way from t0 to t1 at which t lies, kept within [0, 1]: never an extrapolation. */
export function between(t0: number, t1: number, t: number): number {
  if (!(t1 > t0)) return 1;
  return Math.min(1, Math.max(0, (t - t0) / (t1 - t0)));
}
