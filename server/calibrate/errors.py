"""The one error of the offline command for what a person can put right."""

from __future__ import annotations


class CalibrateError(ValueError):
    """A file, a column or an option is not usable; the message says where, the value, the limit and the remedy."""
