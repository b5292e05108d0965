"""Decimal text to float64, correctly rounded as Python's own float() does, in compiled code.

The method is Eisel-Lemire's: one or two 64 × 64 bit products of the digits with a table of powers of five give the
correctly rounded value for every decimal of at most 19 digits [Lemire 2021, "Number parsing at a gigabyte per second",
Software: Practice and Experience 51(8); Mushtak and Lemire 2023, "Fast number parsing without fallback"]. What does
not fit (more digits, quotes, "inf") is left to the caller, who asks Python.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Uint = NDArray[np.uint64]

LOWEST_POWER: Final = -342  # 10^-342 times the largest 19-digit number is below half the smallest subnormal
HIGHEST_POWER: Final = 308
NAN_BITS: Final = np.uint64(0x7FF8000000000000)
SIGN_BIT: Final = np.uint64(1 << 63)

_LOW_32: Final = np.uint64(0xFFFFFFFF)
_PRECISION: Final = np.uint64((1 << 9) - 1)  # 64 − 52 − 3 bits below what rounding needs
_IMPLICIT: Final = np.uint64(1 << 52)
_INFINITE: Final = np.uint64(0x7FF << 52)
_U: Final = tuple(np.uint64(k) for k in range(64))


def _significand_of_five(power: int) -> int:
    """Return the leading 128 bits of 5^power: truncated for positive powers, rounded up for negative ones."""
    if power >= 0:
        value = int(5**power)
        return value << (128 - value.bit_length()) if value.bit_length() <= 128 else value >> (value.bit_length() - 128)
    value = int(5**-power)
    bits = (value - 1).bit_length()
    found: int = (1 << (bits + 127 if power >= -27 else 2 * bits + 128)) // value + 1
    return found >> max(0, found.bit_length() - 128)


def powers_of_five() -> Uint:
    """Return shape (651, 2): high and low 64 bits for each power from LOWEST_POWER to HIGHEST_POWER."""
    mask = (1 << 64) - 1
    values = [_significand_of_five(power) for power in range(LOWEST_POWER, HIGHEST_POWER + 1)]
    return np.array([(value >> 64, value & mask) for value in values], dtype=np.uint64)


@njit("UniTuple(uint64, 2)(uint64, uint64)", cache=True)
def _product(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return the high and low 64 bits of a·b."""
    a_low, a_high, b_low, b_high = a & _LOW_32, a >> _U[32], b & _LOW_32, b >> _U[32]
    low = a_low * b_low
    middle = a_high * b_low + (low >> _U[32])
    cross = a_low * b_high + (middle & _LOW_32)
    high = a_high * b_high + (middle >> _U[32]) + (cross >> _U[32])
    return high, (cross << _U[32]) | (low & _LOW_32)


@njit("int64(uint64)", cache=True)
def _leading_zeros(value: np.uint64) -> int:
    """Return the number of leading zero bits of a value that is not zero."""
    count = 0
    for step in (32, 16, 8, 4, 2, 1):
        if value < (_U[1] << np.uint64(64 - step)):
            value = value << np.uint64(step)
            count += step
    return count


@njit("uint64(uint64, int64)", cache=True)
def _subnormal(mantissa: np.uint64, shift: np.int64) -> np.uint64:
    """Return the bits of a number below the normal range, `shift` bits of its mantissa lost."""
    if shift >= 64:
        return _U[0]
    mantissa = mantissa >> np.uint64(shift)
    return (mantissa + (mantissa & _U[1])) >> _U[1]  # a carry into bit 52 is the smallest normal number: right as is


@njit("uint64(uint64, int64, uint64[:, ::1])", cache=True)
def bits_of_decimal(digits: np.uint64, power: int, five: Uint) -> np.uint64:
    """Return the float64 bits nearest to digits·10^power (ties to even), positive.

    Args:
        digits: at most 19 decimal digits.
        power: of ten.
        five: the table `powers_of_five`.
    """
    if digits == _U[0] or power < LOWEST_POWER:
        return _U[0]
    if power > HIGHEST_POWER:
        return _INFINITE
    zeros = _leading_zeros(digits)
    digits = digits << np.uint64(zeros)
    high, low = _product(digits, five[power - LOWEST_POWER, 0])
    if (high & _PRECISION) == _PRECISION:
        second, _ = _product(digits, five[power - LOWEST_POWER, 1])
        low = low + second
        if second > low:
            high = high + _U[1]
    upper = high >> _U[63]
    shift = upper + _U[9]
    mantissa = high >> shift
    exponent = (((152170 + 65536) * power) >> 16) + 63 + np.int64(upper) - zeros + 1023
    if exponent <= 0:
        return _subnormal(mantissa, 1 - exponent)
    halfway = low <= _U[1] and power >= -4 and power <= 23 and (mantissa & _U[3]) == _U[1]
    if halfway and (mantissa << shift) == high:
        mantissa = mantissa - _U[1]  # exactly between two: to even, hence down
    mantissa = (mantissa + (mantissa & _U[1])) >> _U[1]
    if mantissa >= (_IMPLICIT << _U[1]):
        mantissa, exponent = _IMPLICIT, exponent + 1
    if exponent >= 2047:
        return _INFINITE
    return (mantissa & ~_IMPLICIT) | (np.uint64(exponent) << _U[52])
