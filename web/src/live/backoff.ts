export const FIRST_RETRY_S = 0.5;
export const LAST_RETRY_S = 5;
/** The server says something at least every second; a socket silent for this long is dead. */
export const SILENCE_LIMIT_S = 3;

/** Wait before the n-th attempt in a row (n from 0): 0.5 s doubling to 5 s. */
export function retryDelayS(attempt: number): number {
  return Math.min(LAST_RETRY_S, FIRST_RETRY_S * 2 ** Math.max(0, attempt));
}

/** Whether a socket that last spoke then must be taken for dead now. */
export function isSilent(lastHeardMs: number, nowMs: number): boolean {
  return nowMs - lastHeardMs > SILENCE_LIMIT_S * 1000;
}
