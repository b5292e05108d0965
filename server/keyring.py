"""Who may do what: tokens, the sessions made from them, and a limit on guessing."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Final, NamedTuple

from server.wire_base import Role

SESSION_S: Final = 7 * 86_400.0
MAX_SESSIONS: Final = 256  # the oldest is closed
GUESSES: Final = 10  # wrong tokens of one address within `GUESS_WINDOW_S`
GUESS_WINDOW_S: Final = 60.0
MAX_ADDRESSES: Final = 1024  # the longest unseen is forgotten


class Session(NamedTuple):
    """What a cookie stands for."""

    role: Role
    expires_s: float


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode()).digest()


class Keyring:
    """Tokens by role; without any token everybody who gets here is an operator."""

    def __init__(
        self, operator_token: str | None, viewer_token: str | None, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._clock_s = clock_s
        tokens: list[tuple[str | None, Role]] = [(operator_token, "operator"), (viewer_token, "viewer")]
        self._tokens = [(_digest(token), role) for token, role in tokens if token]
        self._sessions: OrderedDict[bytes, Session] = OrderedDict()
        self._guesses: OrderedDict[str, deque[float]] = OrderedDict()

    @property
    def is_open(self) -> bool:
        """True when no token is configured."""
        return not self._tokens

    def role_of_token(self, token: str, address: str) -> Role | None:
        """Return what the token allows; None (and a guess counted against the address) when it is wrong.

        Every token is compared in full, so that the time taken says nothing of any of them.
        """
        digest = _digest(token)
        matches = [role for known, role in self._tokens if hmac.compare_digest(known, digest)]
        if not matches:
            self._count_guess(address)
            return None
        return matches[0]

    def wait_s(self, address: str) -> float:
        """Return for how long an address that guessed too often has to wait; 0 when it may try."""
        guesses = self._guesses.get(address)
        if guesses is None or len(guesses) < GUESSES:
            return 0.0
        return max(0.0, guesses[0] + GUESS_WINDOW_S - self._clock_s())

    def _count_guess(self, address: str) -> None:
        guesses = self._guesses.setdefault(address, deque(maxlen=GUESSES))
        guesses.append(self._clock_s())
        self._guesses.move_to_end(address)
        if len(self._guesses) > MAX_ADDRESSES:
            self._guesses.popitem(last=False)

    def open_session(self, role: Role) -> str:
        """Return the value of a new cookie: random, so it tells nothing of the token."""
        value = secrets.token_urlsafe(32)
        self._sessions[_digest(value)] = Session(role, self._clock_s() + SESSION_S)
        if len(self._sessions) > MAX_SESSIONS:
            self._sessions.popitem(last=False)
        return value

    def role_of_session(self, value: str) -> Role | None:
        """Return what a cookie allows; None when it is unknown or expired."""
        session = self._sessions.get(_digest(value))
        return session.role if session is not None and session.expires_s > self._clock_s() else None

    def close_session(self, value: str) -> None:
        """Forget a cookie."""
        self._sessions.pop(_digest(value), None)
