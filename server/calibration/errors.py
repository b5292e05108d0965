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
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""What a defect of a collector raises: the job ends with it, and nothing else."""


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
