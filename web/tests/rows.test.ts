import { describe, expect, it } from "vitest";
import { rowsWithFirst } from "../src/live/feeds";
import { decodeRows } from "../src/live/rows";

/** A message written byte by byte as the contract says, independent of the decoder. */
function message(
  version: number,
  id: number,
  bootId: number,
  rows: readonly (readonly number[])[],
): ArrayBuffer {
  const nCols = (rows[0]?.length ?? 1) - 1;
  const view = new DataView(new ArrayBuffer(8 + rows.length * (nCols + 1) * 8));
  view.setUint8(0, version);
  view.setUint8(1, id);
  view.setUint16(2, rows.length, true);
  view.setUint16(4, nCols, true);
  view.setUint16(6, bootId, true);
  rows.flat().forEach((value, i) => view.setFloat64(8 + 8 * i, value, true));
  return view.buffer;
}

describe("decodeRows", () => {
  it("returns times and values of every row", () => {
    const rows = decodeRows(
      message(1, 7, 513, [
        [1e9, 1.5, NaN],
        [2e9, -2.5, 4],
      ]),
    );
    expect(rows).toMatchObject({ id: 7, bootId: 513, nRows: 2, nCols: 2 });
    expect([...(rows?.tNs ?? [])]).toEqual([1e9, 2e9]);
    expect([...(rows?.data ?? [])]).toEqual([1.5, NaN, -2.5, 4]);
  });

  it("keeps nanoseconds of a hundred days exactly", () => {
    const tNs = 100 * 86400e9 + 1;
    expect(decodeRows(message(1, 1, 0, [[tNs, 0]]))?.tNs[0]).toBe(tNs);
  });

  it("takes a message without rows", () => {
    expect(decodeRows(message(1, 1, 0, []))?.nRows).toBe(0);
  });

  it.each([
    ["another version", message(2, 1, 0, [[0, 0]])],
    ["a cut message", message(1, 1, 0, [[0, 0]]).slice(0, -1)],
    ["a lost header", new ArrayBuffer(3)],
  ])("refuses %s", (_, buffer) => {
    expect(decodeRows(buffer)).toBeNull();
  });
});

describe("rowsWithFirst", () => {
  it("keeps the rows of one aid in their order", () => {
    const all = decodeRows(
      message(1, 1, 0, [
        [1, 0, 10],
        [1, 2, 20],
        [2, 0, 30],
      ]),
    );
    const kept = all && rowsWithFirst(all, 0);
    expect(kept?.nRows).toBe(2);
    expect([...(kept?.tNs ?? [])]).toEqual([1, 2]);
    expect([...(kept?.data ?? [])]).toEqual([0, 10, 0, 30]);
  });
});
