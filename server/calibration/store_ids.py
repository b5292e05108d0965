"""Ids of calibration sets: short, in the order in which they were made, unique without asking anybody."""

from __future__ import annotations

import secrets
import threading
import time
from typing import Final

_DIGITS: Final = "0123456789abcdefghjkmnpqrstvwxyz"  # Crockford's base 32: no letter looks like a digit
_TIME_DIGITS: Final = 9  # of milliseconds since 1970: enough until the year 3084
_RANDOM_DIGITS: Final = 4
_lock = threading.Lock()
_last = [0]


def new_id() -> str:
    """Return 13 letters and digits: the milliseconds since 1970, which only ever rise here, and four at random."""
    with _lock:
        _last[0] = max(_last[0] + 1, time.time_ns() // 1_000_000)
        stamp = _last[0]
    digits = [_DIGITS[stamp >> (5 * k) & 31] for k in reversed(range(_TIME_DIGITS))]
    return "".join(digits) + "".join(secrets.choice(_DIGITS) for _ in range(_RANDOM_DIGITS))
