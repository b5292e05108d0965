"""What a command says: its answer on standard output, a refusal on standard error with an exit status."""

from __future__ import annotations

import sys
from typing import Final, NoReturn

import typer

BAD_INPUT: Final = 2


def say(text: str) -> None:
    """Write to standard output, which is what the command was asked for."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def refuse(text: str, status: int = BAD_INPUT) -> NoReturn:
    """Say why not on standard error, and end."""
    sys.stderr.write(f"navdeck: {text}\n")
    raise typer.Exit(status)
