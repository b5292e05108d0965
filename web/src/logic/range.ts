export interface Range {
  readonly min: number;
  readonly max: number;
}

/** Round outwards to a number of the 1-2-5 series per tenth of the span. */
function rounded(min: number, max: number): Range {
  const rough = (max - min) / 8;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = ([1, 2, 5, 10].find((each) => each * power >= rough) ?? 10) * power;
  return { min: Math.floor(min / step) * step, max: Math.ceil(max / step) * step };
}

/**
 * Range of an axis that shows low to high without twitching: the present one is kept while the data fill between a
 * third and all of it; `least` is the smallest span worth showing.
 */
export function steadyRange(present: Range | null, low: number, high: number, least: number): Range {
  if (!(high >= low)) return present ?? { min: 0, max: 1 };
  const span = Math.max(high - low, least);
  const middle = (high + low) / 2;
  if (present) {
    const held = present.max - present.min;
    if (low >= present.min && high <= present.max && span > held / 3) return present;
  }
  return rounded(middle - span * 0.58, middle + span * 0.58);
}
