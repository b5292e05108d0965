/** What is shown for a value that is not known; zero is never shown for unknown. */
export const DASH = "–";
const MINUS = "\u2212";

/** Fixed decimals with a real minus sign, never "−0"; a dash when unknown. */
export function fixed(value: number | null | undefined, decimals: number): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** A difference with its sign, "+0.20" or "−0.20"; "0.00" has none. */
export function signed(value: number | null | undefined, decimals: number): string {
  const text = fixed(value, decimals);
  return text !== DASH && (value ?? 0) > 0 && Number(text) !== 0 ? `+${text}` : text;
}

/** Three significant digits or so, for quantities whose size is not known beforehand. */
export function compact(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  const size = Math.abs(value);
  if (size !== 0 && size < 1e-3) return value.toExponential(1).replace("-", MINUS);
  return fixed(value, size >= 1000 ? 0 : size >= 100 ? 1 : size >= 1 ? 2 : 3);
}

/** Decimals that tell a two-hundredth of a span apart, so that a number beside a plot keeps its width. */
export function decimalsFor(span: number): number {
  if (!(span > 0) || !Number.isFinite(span)) return 2;
  return Math.min(7, Math.max(0, Math.ceil(Math.log10(200 / span))));
}

/** Whole numbers with thin spaces between thousands: 12 345 678. */
export function count(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  return Math.round(value)
    .toString()
    .replace(/\B(?=(\d{3})+(?!\d))/g, "\u2009");
}

export function bytes(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  if (value < 1000) return `${Math.round(value)} B`;
  if (value < 1e6) return `${(value / 1e3).toFixed(1)} kB`;
  return value < 1e9 ? `${(value / 1e6).toFixed(1)} MB` : `${(value / 1e9).toFixed(2)} GB`;
}

/** Age or duration in the largest fitting unit: "0.4 s", "12 s", "3 min", "2 h". */
export function duration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return DASH;
  const s = Math.max(0, seconds);
  if (s < 9.95) return `${s.toFixed(1)} s`;
  if (s < 119.5) return `${Math.round(s)} s`;
  if (s < 7200) return `${Math.round(s / 60)} min`;
  return s < 172800 ? `${(s / 3600).toFixed(1)} h` : `${Math.round(s / 86400)} d`;
}

/** Seconds since power-up as a clock for time axes: "1:02:03" or "2:03.4". */
export function clock(seconds: number, decimals = 0): string {
  if (!Number.isFinite(seconds)) return DASH;
  const sign = seconds < 0 ? MINUS : "";
  const scale = 10 ** decimals;
  const total = Math.round(Math.abs(seconds) * scale) / scale;
  const h = Math.floor(total / 3600);
  const m = Math.floor((total % 3600) / 60);
  const s = (total % 60).toFixed(decimals).padStart(decimals ? 3 + decimals : 2, "0");
  return h > 0 ? `${sign}${h}:${String(m).padStart(2, "0")}:${s}` : `${sign}${m}:${s}`;
}

/** Uncertainty in words of the display: 0.82 → "0.8", 6.3 → "6", 140 → "140". */
export function spread(value: number): string {
  return fixed(value, value < 0.095 ? 2 : value < 2.95 ? 1 : 0);
}
