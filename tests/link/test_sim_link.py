from __future__ import annotations

from server.link import LinkState, open_link
from tests.link.support import exists, listening


async def test_the_demo_board_speaks_mavlink_through_a_real_terminal_and_leaves_it() -> None:
    link = open_link("sim:?seed=2")
    async with listening(link) as heard:
        await heard.until(lambda: b"\xfd" in heard.data)
        assert link.status.state is LinkState.OPEN
        device = link._device  # type: ignore[attr-defined]
        assert exists(device)
    assert not exists(device)
