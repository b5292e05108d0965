"""Decimal text against Python's own float(), bit for bit."""

from __future__ import annotations

import math
import random
import struct

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from server.replay.csv_cells import integer, number_bits
from server.replay.numbers import bits_of_decimal, powers_of_five

FIVE = powers_of_five()


def bits(value: float) -> int:
    return struct.unpack("<Q", struct.pack("<d", value))[0]


def parsed(text: str) -> tuple[bool, int]:
    raw = np.frombuffer(text.encode(), dtype=np.uint8).copy()
    plain, found = number_bits(raw, 0, len(raw), FIVE)
    return bool(plain), int(found)


def test_a_hundred_thousand_random_decimals_of_every_magnitude_are_rounded_as_python_does() -> None:
    rng = random.Random(20)
    for _ in range(100_000):
        digits, power = rng.getrandbits(rng.randint(1, 63)), rng.randint(-345, 312)
        assert int(bits_of_decimal(np.uint64(digits), power, FIVE)) == bits(float(f"{digits}e{power}")), (digits, power)


def test_every_finite_number_survives_its_shortest_text() -> None:
    rng = random.Random(21)
    for _ in range(50_000):
        value = struct.unpack("<d", struct.pack("<Q", rng.getrandbits(64)))[0]
        if math.isfinite(value):
            assert parsed(repr(value)) == (True, bits(value)), value


def test_halfway_cases_go_to_even() -> None:
    rng = random.Random(22)
    for _ in range(20_000):
        middle = (1 << 53) + 2 * rng.getrandbits(52) + 1  # exactly between two float64
        for power in range(5):
            if (digits := middle * 5**power) < 10**19:
                found = int(bits_of_decimal(np.uint64(digits), -power, FIVE))
                assert found == bits(float(f"{digits}e-{power}"))


@given(st.from_regex(r"[+-]?[0-9]{0,12}\.?[0-9]{0,12}([eE][+-]?[0-9]{1,3})?", fullmatch=True))
@settings(max_examples=500)
@example("1.")
@example(".5")
@example("+.5E+3")
@example("-0")
@example("00012.5000")
@example("1e400")
@example("4.9406564584124654e-324")
@example("2.2250738585072011e-308")
def test_a_plain_decimal_reads_as_python_reads_it_or_is_left_to_python(text: str) -> None:
    try:
        want = float(text)
    except ValueError:
        assert not text or not parsed(text)[0]
        return
    plain, found = parsed(text)
    assert not plain or found == bits(want)
    assert plain or len(text.lstrip("+-0.")) > 19


@pytest.mark.parametrize("text", ["", "nan", "NaN", "NAN"])
def test_an_empty_cell_and_nan_are_unknown(text: str) -> None:
    plain, found = parsed(text)
    assert plain
    assert np.isnan(np.array([found], dtype=np.uint64).view(np.float64)[0])


@pytest.mark.parametrize("text", ["1,5", "1 5", "1e", "e5", "--1", "1.2.3", "0x10", "1_000", "abc", ".", "+", "inf"])
def test_what_is_not_a_plain_decimal_is_never_guessed(text: str) -> None:
    assert parsed(text) == (False, 0)


@pytest.mark.parametrize(
    "value", [0, 1, -1, 2**53 + 1, 1795312368672182001, 2**63 - 1, -(2**63) + 1, 12345678901234567]
)
def test_stamps_are_exact_over_the_whole_of_int64(value: int) -> None:
    raw = np.frombuffer(str(value).encode(), dtype=np.uint8).copy()
    assert integer(raw, 0, len(raw)) == (1, value)


@pytest.mark.parametrize("text", ["9223372036854775808", "99999999999999999999", "1.0", "1e9", "", "-", "12a"])
def test_a_stamp_that_int64_cannot_hold_or_that_is_no_integer_is_refused(text: str) -> None:
    raw = np.frombuffer(text.encode(), dtype=np.uint8).copy() if text else np.empty(0, dtype=np.uint8)
    assert integer(raw, 0, len(raw))[0] == 0
