"""Links: one way to a board each, chosen by a URL."""

from __future__ import annotations

from server.link.base import Chunk, Link, LinkState, LinkStatus
from server.link.url import open_link

__all__ = ["Chunk", "Link", "LinkState", "LinkStatus", "open_link"]
