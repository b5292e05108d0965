"""Every way a link can be unwell: one table from a stable code to its state, cause and remedy.

The page translates by `code` and fills in `LinkStatus.details`; the English sentences here are what the API and
the command line show. What the bytes themselves tell of a link that is open (a wrong baud rate, another protocol) is
found by `server.protocol.detect` and put over the link's status by the board.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Final, NamedTuple

from server.link.base import LinkState


class Cause(NamedTuple):
    """One row of the table; `{name}` in a sentence is filled from the details."""

    state: LinkState
    cause: str
    remedy: str


_FIX_PERMISSION: Final = (
    "Add your user to the group {group} and log in again: sudo usermod -aG {group} $USER. "
    "In a container, pass the device (devices:) and the group (group_add: dialout)."
)

CAUSES: Final[dict[str, Cause]] = {
    "opening": Cause(LinkState.OPENING, "The link is being opened.", "Wait a moment."),
    # serial
    "port-busy": Cause(
        LinkState.BUSY,
        "{device} is held by {holder}.",
        "Close that program (a ground station, ModemManager, a terminal); the port is taken as soon as it is free.",
    ),
    "in-use-here": Cause(
        LinkState.BUSY, "{device} is in use by this navdeck already.", "Nothing to do: it is one of the boards shown."
    ),
    "no-permission": Cause(LinkState.NO_PERMISSION, "This user may not open {device}.", _FIX_PERMISSION),
    "port-missing": Cause(
        LinkState.NOT_FOUND,
        "There is no {device}.",
        "Plug the board in with a data cable (some only charge), or choose another port: navdeck ports lists them.",
    ),
    "unplugged": Cause(
        LinkState.LOST,
        "{device} went away: the board was unplugged or restarted.",
        "Plug it in again; it is found under any port name.",
    ),
    "other-device": Cause(
        LinkState.NOT_FOUND,
        "{identity} was unplugged and another device is now at {device}.",
        "Plug the same board in again, or connect anew to use the other one.",
    ),
    "not-a-port": Cause(
        LinkState.FAILED, "{device} is not a serial port: {error}.", "Choose another port: navdeck ports lists them."
    ),
    "baud-refused": Cause(
        LinkState.FAILED,
        "{device} does not do {baud} baud.",
        "Use a rate the adapter supports, e.g. 57600, 115200 or 921600.",
    ),
    "no-board": Cause(
        LinkState.NOT_FOUND,
        "No serial board is plugged in.",
        "Plug a board in with a data cable; it is opened as soon as it appears. Without one, try the demo: sim:",
    ),
    "all-unusable": Cause(
        LinkState.NOT_FOUND,
        "Serial ports exist but none can be opened: {ports}.",
        "Close the programs that hold them, or allow this user to open them: navdeck ports says why for each.",
    ),
    "silent": Cause(
        LinkState.SILENT,
        "{device} is open but no byte arrives.",
        "Check that the board has power, that TX and RX are crossed, and that this is the telemetry port.",
    ),
    # network
    "silent-network": Cause(
        LinkState.SILENT,
        "{address} is connected but no byte arrives.",
        "Check that the other side forwards telemetry on this port.",
    ),
    "silent-udp": Cause(
        LinkState.SILENT,
        "No datagram arrives at {address}.",
        "Point the board's telemetry at this port. "
        "127.0.0.1 hears only this machine: use udp://0.0.0.0:{port} for others.",
    ),
    "waiting-for-peer": Cause(
        LinkState.OPENING,
        "Nobody has connected to {address} yet.",
        "Let the board or bridge connect here. 127.0.0.1 hears only this machine: "
        "use tcp-listen://0.0.0.0:{port} for others.",
    ),
    "refused": Cause(
        LinkState.NOT_FOUND,
        "{address} refuses the connection: no program listens there.",
        "Start the board or bridge there, or correct the port; it is tried again by itself.",
    ),
    "host-not-found": Cause(
        LinkState.NOT_FOUND, "The name {host} is not known.", "Correct the name, or use the address in numbers."
    ),
    "unreachable": Cause(
        LinkState.NOT_FOUND,
        "{address} does not answer: {error}.",
        "Check the cable or Wi-Fi, the address and the firewall; it is tried again by itself.",
    ),
    "address-in-use": Cause(
        LinkState.BUSY,
        "Another program already listens at {address}.",
        "Close it (a ground station?), or choose another port.",
    ),
    "address-not-here": Cause(
        LinkState.FAILED,
        "{address} cannot be listened at: {error}.",
        "Use an address of this machine, 127.0.0.1 or 0.0.0.0, and a port above 1023.",
    ),
    "connection-lost": Cause(
        LinkState.LOST, "The connection to {address} was closed.", "Nothing to do: it is made again by itself."
    ),
    # files and the demo board
    "file-missing": Cause(LinkState.NOT_FOUND, "There is no file {path}.", "Correct the path."),
    "file-unreadable": Cause(LinkState.FAILED, "{path} cannot be played: {error}", "Choose a .tlog or a byte dump."),
    "file-ended": Cause(LinkState.ENDED, "{path} was played to its end.", "Reconnect to play it again, or add loop=1."),
    "sim-failed": Cause(LinkState.FAILED, "The demo board did not start: {error}.", "See navdeck doctor."),
    "closed": Cause(LinkState.ENDED, "The link was closed.", "Reconnect to open it again."),
}


class Trouble(Exception):  # noqa: N818 - a state of the world a person can act on, not an error of the program
    """A link cannot be opened or was lost; `code` is a key of `CAUSES`."""

    def __init__(self, code: str, **details: str) -> None:
        super().__init__(explain(code, details)[1])
        self.code = code
        self.details = details


def explain(code: str, details: dict[str, str]) -> tuple[LinkState, str, str]:
    """Return (state, cause, remedy) of a code with its sentences filled in; an unknown detail reads "?"."""
    row = CAUSES[code]
    filled = defaultdict(lambda: "?", details)
    return row.state, row.cause.format_map(filled), row.remedy.format_map(filled)
