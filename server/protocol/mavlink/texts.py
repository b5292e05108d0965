"""STATUSTEXT: what the board says in words, pieced together when it comes in chunks."""

from __future__ import annotations

CHUNK = 50


class TextAssembler:
    """Join the chunks of one text; a text whose last chunk never comes is given out when the next one begins."""

    def __init__(self) -> None:
        self._id = 0
        self._severity = 0
        self._parts = b""

    def feed(self, payload: bytes) -> list[tuple[int, str]]:
        """Take a STATUSTEXT payload; return the complete texts as (severity 0..7, text)."""
        payload = payload.ljust(54, b"\0")
        severity, part = payload[0], payload[1:51]
        text_id, chunk = int.from_bytes(payload[51:53], "little"), payload[53]
        done: list[tuple[int, str]] = []
        if self._parts and (text_id != self._id or chunk == 0):
            done.append(self._flush())
        self._id, self._severity = text_id, severity
        self._parts += part.split(b"\0", 1)[0]
        if text_id == 0 or b"\0" in part:
            done.append(self._flush())
        return [item for item in done if item[1]]

    def _flush(self) -> tuple[int, str]:
        text = self._parts.decode("utf-8", "replace").strip()
        self._parts = b""
        return self._severity, text
