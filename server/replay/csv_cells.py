"""The cells of a CSV file in compiled code: integer stamps exactly, numbers correctly rounded, empty = NaN."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from server.replay.numbers import NAN_BITS, SIGN_BIT, Uint, bits_of_decimal

T_NS: Final = -1  # target of the cell that holds the stamp
IGNORED: Final = -2

END, TOO_FEW, TOO_MANY, BAD_STAMP, NO_ROOM = 0, 1, 2, 3, 4
"""How the scan ended: at the end of the text, or at a line it cannot take."""

_COMMA: Final = 44
_NEWLINE: Final = 10
_RETURN: Final = 13
_SPACE: Final = 32
_TAB: Final = 9
_POINT: Final = 46
_MINUS: Final = 45
_PLUS: Final = 43
_ZERO: Final = 48
_MOST_DIGITS: Final = 19
_INT64_MAX: Final = (1 << 63) - 1
_TEN: Final = np.uint64(10)


@njit("boolean(uint8)", cache=True)
def _is_digit(c: int) -> bool:
    return 48 <= c <= 57


@njit("UniTuple(int64, 2)(uint8[::1], int64, int64)", cache=True)
def _trimmed(text: NDArray[np.uint8], begin: int, end: int) -> tuple[int, int]:
    """Return the cell without the blanks around it."""
    while begin < end and (text[begin] == _SPACE or text[begin] == _TAB):
        begin += 1
    while end > begin and (text[end - 1] == _SPACE or text[end - 1] == _TAB or text[end - 1] == _RETURN):
        end -= 1
    return begin, end


@njit("boolean(uint8[::1], int64, int64)", cache=True)
def _is_nan(text: NDArray[np.uint8], begin: int, end: int) -> bool:
    """Tell whether the cell says nan, in any case."""
    return end - begin == 3 and text[begin] | 32 == 110 and text[begin + 1] | 32 == 97 and text[begin + 2] | 32 == 110


@njit("Tuple((boolean, uint64))(uint8[::1], int64, int64, uint64[:, ::1])", cache=True)
def number_bits(text: NDArray[np.uint8], begin: int, end: int, five: Uint) -> tuple[bool, np.uint64]:
    """Return (True, float64 bits) of the trimmed cell, or (False, 0) for what is not a plain decimal of ≤ 19 digits."""
    if begin == end or _is_nan(text, begin, end):
        return True, NAN_BITS
    at, sign = begin, np.uint64(0)
    if text[at] == _MINUS or text[at] == _PLUS:
        sign = SIGN_BIT if text[at] == _MINUS else sign
        at += 1
    digits, count, seen, power = np.uint64(0), 0, 0, 0
    pointed = False
    while at < end and (_is_digit(text[at]) or (text[at] == _POINT and not pointed)):
        if text[at] == _POINT:
            pointed = True
        else:
            digits = digits * _TEN + np.uint64(text[at] - _ZERO)
            count += 1 if digits else 0
            seen += 1
            power -= 1 if pointed else 0
        at += 1
    if seen == 0 or count > _MOST_DIGITS:
        return False, np.uint64(0)
    if at < end and text[at] | 32 == 101:  # e, E
        at += 1
        down = at < end and text[at] == _MINUS
        at += 1 if at < end and (text[at] == _MINUS or text[at] == _PLUS) else 0
        value, first = 0, at
        while at < end and _is_digit(text[at]) and value < 100000:
            value = value * 10 + (text[at] - _ZERO)
            at += 1
        if at == first:
            return False, np.uint64(0)
        power += -value if down else value
    if at != end:
        return False, np.uint64(0)
    return True, sign | bits_of_decimal(digits, power, five)


@njit("UniTuple(int64, 2)(uint8[::1], int64, int64)", cache=True)
def integer(text: NDArray[np.uint8], begin: int, end: int) -> tuple[int, int | np.int64]:
    """Return (1, value) of the trimmed cell, or (0, 0) when it is not an integer that int64 holds."""
    at = begin
    if at < end and (text[at] == _MINUS or text[at] == _PLUS):
        at += 1
    if at == end or end - at > _MOST_DIGITS:
        return 0, 0
    value = np.int64(0)
    for k in range(at, end):
        digit = np.int64(text[k]) - _ZERO
        if not _is_digit(text[k]) or value > (_INT64_MAX - digit) // 10:
            return 0, 0
        value = value * 10 + digit
    return 1, -value if text[begin] == _MINUS else value


@njit(
    "int64[::1](uint8[::1], int64, int64[::1], int64[::1], uint64[:, ::1], int64[:, ::1], uint64[:, ::1])", cache=True
)
def scan_cells(
    text: NDArray[np.uint8],
    at: int,
    target: NDArray[np.int64],
    t_ns: NDArray[np.int64],
    out: Uint,
    odd: NDArray[np.int64],
    five: Uint,
) -> NDArray[np.int64]:
    """Read lines from `at` to the end of the text into the table.

    Args:
        text: the whole file.
        at: where the first line after the header begins.
        target: shape (cells a line,), the column of `out` each cell goes to, or T_NS, or IGNORED.
        t_ns: room for the stamps.
        out: room for the numbers, as float64 bits.
        odd: room for the cells left to the caller: row, column, begin, end.
        five: the table of `powers_of_five`.

    Returns:
        [how it ended, rows, odd cells, where the line of trouble begins, and its cell].
    """
    row, odds, size, width = 0, 0, len(text), len(target)
    while at < size:
        line, cell = at, 0
        blank = True
        while True:
            end = at
            while end < size and text[end] != _COMMA and text[end] != _NEWLINE:
                end += 1
            last = end == size or text[end] == _NEWLINE
            begin, stop = _trimmed(text, at, end)
            blank = blank and begin == stop
            at = end + 1
            if cell >= width:
                if begin != stop:
                    return np.array([TOO_MANY, row, odds, line, cell])
            elif target[cell] == T_NS:
                good, value = integer(text, begin, stop)
                if not good and not (last and cell == 0 and blank):
                    return np.array([BAD_STAMP, row, odds, line, cell])
                t_ns[row] = value
            elif target[cell] >= 0:
                plain, bits = number_bits(text, begin, stop, five)
                if not plain:
                    if odds == len(odd):
                        return np.array([NO_ROOM, row, odds, line, cell])
                    odd[odds, 0], odd[odds, 1], odd[odds, 2], odd[odds, 3] = row, cell, begin, stop
                    odds += 1
                    bits = NAN_BITS
                out[row, target[cell]] = bits
            cell += 1
            if last:
                break
        if blank and cell == 1:
            continue
        if cell < width:
            return np.array([TOO_FEW, row, odds, line, cell])
        row += 1
    return np.array([END, row, odds, size, 0])
