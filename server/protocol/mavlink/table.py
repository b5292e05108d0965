"""What every MAVLink message looks like: check byte, length and name, from pymavlink's `all` dialect.

`all` contains `ardupilotmega`, `common` and `development` unchanged (a test holds it to that). Importing its
definitions takes about 30 ms, so nothing is cached.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

ID_SPACE: Final = 65536
"""Ids from here on are unknown to every dialect; the wire allows 2^24."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MessageTable:
    """All known messages; `index` counts them in order of their ids.

    Attributes:
        index_of_id: shape (ID_SPACE,), int16, -1 = unknown.
        crc_extra: shape (n,), uint8.
        length: shape (n,), uint8, payload bytes with all extensions.
        ids: shape (n,), int64.
        names: n names.
    """

    index_of_id: NDArray[np.int16]
    crc_extra: NDArray[np.uint8]
    length: NDArray[np.uint8]
    ids: NDArray[np.int64]
    names: tuple[str, ...]

    def name(self, message_id: int) -> str:
        """Return the message's name, or UNKNOWN_<id>."""
        index = int(self.index_of_id[message_id]) if 0 <= message_id < ID_SPACE else -1
        return self.names[index] if index >= 0 else f"UNKNOWN_{message_id}"


@lru_cache(maxsize=1)
def message_table() -> MessageTable:
    """Return the table of all messages, built on first use."""
    from pymavlink.dialects.v20 import all as dialect

    messages: dict[int, Any] = dialect.mavlink_map
    ids = sorted(messages)
    index_of_id = np.full(ID_SPACE, -1, np.int16)
    index_of_id[ids] = np.arange(len(ids), dtype=np.int16)
    return MessageTable(
        index_of_id=index_of_id,
        crc_extra=np.array([messages[k].crc_extra for k in ids], np.uint8),
        length=np.array([messages[k].unpacker.size for k in ids], np.uint8),
        ids=np.array(ids, np.int64),
        names=tuple(str(messages[k].msgname) for k in ids),
    )
