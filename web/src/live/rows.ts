/** One binary message of the stream: n rows of n columns, each row with its board time. */
export interface Rows {
  readonly id: number;
  readonly bootId: number;
  readonly nRows: number;
  readonly nCols: number;
  /** shape (nRows,), board time, ns since power-up: exact in a double for 104 days. */
  readonly tNs: Float64Array;
  /** shape (nRows · nCols,), row by row; unknown = NaN. */
  readonly data: Float64Array;
}

export const ROWS_VERSION = 1;
const HEADER_BYTES = 8;

/** Return the decoded message, or null when it is not one this page understands. */
export function decodeRows(buffer: ArrayBuffer): Rows | null {
  if (buffer.byteLength < HEADER_BYTES) return null;
  const view = new DataView(buffer);
  if (view.getUint8(0) !== ROWS_VERSION) return null;
  const nRows = view.getUint16(2, true);
  const nCols = view.getUint16(4, true);
  const stride = nCols + 1;
  if (buffer.byteLength !== HEADER_BYTES + nRows * stride * 8) return null;
  const flat = readFloats(buffer, nRows * stride);
  const tNs = new Float64Array(nRows);
  const data = new Float64Array(nRows * nCols);
  for (let row = 0; row < nRows; row++) {
    tNs[row] = flat[row * stride] ?? NaN;
    data.set(flat.subarray(row * stride + 1, (row + 1) * stride), row * nCols);
  }
  return { id: view.getUint8(1), bootId: view.getUint16(6, true), nRows, nCols, tNs, data };
}

const littleEndian = new Uint8Array(new Uint16Array([1]).buffer)[0] === 1;

/** The header is 8 bytes, so the doubles are aligned and need no copy on a little-endian machine. */
function readFloats(buffer: ArrayBuffer, count: number): Float64Array {
  if (littleEndian) return new Float64Array(buffer, HEADER_BYTES, count);
  const view = new DataView(buffer, HEADER_BYTES);
  return Float64Array.from({ length: count }, (_, i) => view.getFloat64(i * 8, true));
}
