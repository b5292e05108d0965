/** Standard deviation of the values from index `first` on, unknown ones left out; NaN for fewer than two. */
export function deviation(values: ArrayLike<number>, first = 0): number {
  let [n, mean, sum] = [0, 0, 0];
  for (let i = first; i < values.length; i++) {
    const value = values[i] as number;
    if (Number.isNaN(value)) continue;
    n++;
    const before = value - mean;
    mean += before / n;
    sum += before * (value - mean);
  }
  return n < 2 ? NaN : Math.sqrt(sum / (n - 1));
}
