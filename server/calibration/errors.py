"""What the calibration store and its exchange formats refuse, with a code for REST and a sentence for people."""

from __future__ import annotations

from typing import Final

STORE_CODES: Final[dict[str, int]] = {
    "no-such-set": 404,
    "set-exists": 409,
    "set-in-force": 409,
    "nothing-before": 409,
    "nothing-in-force": 409,
    "sensor-mismatch": 422,
    "store-busy": 503,
    "store-unavailable": 503,
}
"""Code → the HTTP status that fits it."""


DEFECTS: Final = (
    ArithmeticError,  # a division by a spread or a norm that is 0, an overflow
    AttributeError,  # of None, where a result was taken for granted
    LookupError,  # an index past the samples, a parameter that is not there
    MemoryError,  # hours of samples in one fit
    RuntimeError,  # a search that does not come to an end
    TypeError,  # a kernel called with another type than it was compiled for
    ValueError,  # shapes that do not fit; NumPy's LinAlgError, SciPy's refusal of NaN
)
"""What a defect of a collector raises: the job ends with it, and nothing else.

All that arithmetic on samples can raise, hence this wide; not `Exception`: a failing disk (OSError) is no such defect.
"""


class StoreError(Exception):
    """The store refuses or cannot; nothing was changed.

    Attributes:
        code: one of `STORE_CODES`, kebab-case.
        status: the HTTP status that fits it.
    """

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code
        self.status = STORE_CODES[code]


class ExchangeError(ValueError):
    """A file from elsewhere cannot be read as a calibration; the message says where, what and the remedy."""
