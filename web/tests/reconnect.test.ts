import { describe, expect, it } from "vitest";
import { isSilent, retryDelayS, SILENCE_LIMIT_S } from "../src/live/backoff";
import { freshness } from "../src/logic/stale";

describe("retryDelayS", () => {
  it("starts at half a second, doubles, and stays at five", () => {
    expect([0, 1, 2, 3, 4, 5, 50].map(retryDelayS)).toEqual([0.5, 1, 2, 4, 5, 5, 5]);
  });
});

describe("isSilent", () => {
  it("gives a socket that ticks every second two missed ticks, then takes it for dead", () => {
    expect(SILENCE_LIMIT_S).toBe(3);
    expect(isSilent(1000, 3999)).toBe(false);
    expect(isSilent(1000, 4001)).toBe(true);
  });
});

describe("freshness", () => {
  it("is stale after one second and missing when there never was a value", () => {
    expect([0, 1, 1.01, Infinity, null, undefined, NaN].map(freshness)).toEqual([
      "fresh",
      "fresh",
      "stale",
      "missing",
      "missing",
      "missing",
      "missing",
    ]);
  });
});
