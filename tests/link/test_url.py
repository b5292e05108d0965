from __future__ import annotations

import re
import string

import pytest

from server.link import open_link
from server.link.base import LinkState
from server.link.causes import CAUSES, Trouble, explain

GOOD = [
    "auto",
    "auto?baud=57600",
    "auto:",
    "sim",
    "sim:",
    "sim:?seed=3&outage=60:85",
    "serial:///dev/ttyACM0?baud=921600",
    "serial:/dev/ttyACM0",
    "/dev/ttyUSB0",
    "/dev/ttyUSB0?baud=57600",
    "tcp://192.168.4.1:5760",
    "tcp://[::1]:5760",
    "tcp-listen://:5760",
    "tcp-listen://0.0.0.0:5760",
    "udp://:14550",
    "udp://0.0.0.0:14550",
    "file:///tmp/flight.tlog?speed=0&loop=1",
    "file://flight.bin?bytes_per_s=6300",
    "rfc2217://localhost:2217?ign_set_control&baud=57600",
    "socket://localhost:4000",
]

BAD = {
    "": "is not a link",
    "ttyACM0": "is not a link",
    "http://example.com": "is not a link",
    "/logs/flight.tlog": "file:///logs/flight.tlog",
    "serial://": "names no port",
    "serial://ttyACM0": "whole path",
    "serial:///dev/ttyACM0?baud=fast": "baud is a number from 50",
    "serial:///dev/ttyACM0?baud=7": "baud is a number from 50",
    "serial:///dev/ttyACM0?parity=even": "Allowed: baud",
    "auto:/dev/ttyACM0": "write auto",
    "auto?baud=0": "baud is a number",
    "tcp://:5760": "Write host and port",
    "tcp://board": "Write host and port",
    "tcp://board:99999": "0 to 65535",
    "tcp://board:telemetry": "0 to 65535",
    "tcp://user@board:5760": "Write host and port",
    "tcp://board:5760/path": "Write host and port",
    "udp://14550": "Write host and port, such as udp://:14550",
    "udp://:14550?timeout=3": "Allowed: none",
    "file://": "names no file",
    "file://a.tlog?speed=-1": "speed is a number from 0",
    "file://a.tlog?speed=nan": "speed is a number from 0",
    "file://a.tlog?pace=2": "Allowed: speed, loop, bytes_per_s",
    "sim:?wind=99": "wind",
    "spy:///dev/ttyACM0?file=/tmp/log": "would write a file",
}


@pytest.mark.parametrize("url", GOOD)
def test_a_good_url_gives_a_link_that_is_not_open_yet(url: str) -> None:
    status = open_link(url).status
    assert status.state is LinkState.OPENING
    assert status.url.startswith(url)


@pytest.mark.parametrize(("url", "remedy"), BAD.items())
def test_a_bad_url_is_named_with_its_remedy(url: str, remedy: str) -> None:
    with pytest.raises(ValueError, match=re.escape(remedy)) as refusal:
        open_link(url)
    assert url.partition("?")[0].partition(":")[0] in str(refusal.value)


@pytest.mark.parametrize(("code", "row"), CAUSES.items())
def test_every_cause_reads_as_sentences(code: str, row: tuple[LinkState, str, str]) -> None:
    _, cause, remedy = row
    names = {name for text in (cause, remedy) for _, name, _, _ in string.Formatter().parse(text) if name}
    state, cause, remedy = explain(code, {name: "value." if name == "error" else "value" for name in names})
    assert state is not LinkState.OPEN
    assert "?" not in cause
    assert "{" not in cause + remedy
    assert cause[-1] == "."
    assert remedy.strip()


def test_every_state_a_link_can_be_in_has_a_cause() -> None:
    judged_by_the_board = {LinkState.WRONG_BAUD, LinkState.FOREIGN_PROTOCOL}
    assert {row.state for row in CAUSES.values()} == set(LinkState) - {LinkState.OPEN} - judged_by_the_board


def test_trouble_says_its_cause() -> None:
    assert str(Trouble("port-missing", device="/dev/ttyACM0")) == "There is no /dev/ttyACM0."
