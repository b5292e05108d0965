from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

from server.link import LinkState, open_link
from server.link.auto import AutoLink
from server.link.find import Finder
from server.ports import list_ports
from tests.link.support import FakeMachine, PtyBoard, listening, locked, ordinary_user

PIXHAWK = "usb-ArduPilot_Pixhawk6X_1D0030-if00"


@pytest.fixture
def machine(tmp_path: Path) -> FakeMachine:
    return FakeMachine(tmp_path)


async def test_auto_waits_for_a_board_and_opens_it(machine: FakeMachine) -> None:
    board = PtyBoard(machine)
    async with listening(open_link("auto", finder=machine.finder)) as heard:
        await heard.until_code("no-board")
        assert heard.link.status.state is LinkState.NOT_FOUND
        assert "sim:" in heard.link.status.remedy
        board.plug("ttyACM0")
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        board.say(b"hello")
        await heard.until_data(b"hello")
    board.unplug()


async def test_auto_works_without_udev_links(machine: FakeMachine) -> None:
    board = PtyBoard(machine)
    board.plug("ttyUSB3", by_id=False)
    async with listening(open_link("auto", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
    board.unplug()


def test_an_autopilot_is_tried_before_other_devices(machine: FakeMachine) -> None:
    boards = [PtyBoard(machine, "usb-1a86_Serial-if00"), PtyBoard(machine, PIXHAWK), PtyBoard(machine)]
    boards[0].plug("ttyUSB0")
    boards[1].plug("ttyACM1")
    boards[2].plug("ttyACM0", by_id=False)
    found = machine.finder.boards()
    assert [device.name for device in found] == [PIXHAWK, "usb-1a86_Serial-if00", "ttyACM0"]
    for board in boards:
        board.unplug()


async def test_auto_skips_a_busy_port(machine: FakeMachine) -> None:
    busy, free = PtyBoard(machine, PIXHAWK), PtyBoard(machine, "usb-other-if00")
    busy.plug("ttyACM0")
    free.plug("ttyACM1")
    with locked(busy.tty):
        async with listening(open_link("auto", finder=machine.finder)) as heard:
            await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
            free.say(b"free")
            await heard.until_data(b"free")
    busy.unplug()
    free.unplug()


async def test_auto_names_every_port_that_cannot_be_opened(machine: FakeMachine) -> None:
    boards = [PtyBoard(machine, "usb-a-if00"), PtyBoard(machine, "usb-b-if00")]
    for k, board in enumerate(boards):
        board.plug(f"ttyACM{k}")
    with locked(boards[0].tty, boards[1].tty):
        async with listening(open_link("auto", finder=machine.finder)) as heard:
            await heard.until_code("all-unusable")
            assert "usb-a-if00" in heard.link.status.cause
            assert "usb-b-if00" in heard.link.status.cause
    for board in boards:
        board.unplug()


async def test_a_silent_device_gives_way_to_one_that_speaks(machine: FakeMachine) -> None:
    silent, speaking = PtyBoard(machine, PIXHAWK), PtyBoard(machine, "usb-z-if00")
    silent.plug("ttyACM0")
    link = AutoLink("auto", 115_200, machine.finder, trial_s=0.1)
    async with listening(link) as heard:
        await heard.until(lambda: link.status.state is LinkState.OPEN)
        speaking.plug("ttyACM1")
        await heard.until(lambda: link.status.reconnects == 1)
        speaking.say(b"here")
        await heard.until_data(b"here")
    silent.unplug()
    speaking.unplug()


async def test_after_a_loss_auto_takes_the_same_board_before_a_likelier_one(machine: FakeMachine) -> None:
    board, other = PtyBoard(machine, "usb-z-if00"), PtyBoard(machine, PIXHAWK)
    board.plug("ttyACM0")
    async with listening(open_link("auto", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        board.say(b"one")
        await heard.until_data(b"one")
        board.unplug()
        board.plug("ttyACM1")
        other.plug("ttyACM0")
        await heard.until(lambda: heard.link.status.reconnects == 1)
        board.say(b"two")
        await heard.until_data(b"two")
    board.unplug()
    other.unplug()


def usb_tree(root: Path, name: str, serial: str, number: str) -> None:
    """A cdc-acm port as the kernel describes it."""
    interface = root / f"usb-{serial}" / f"1-1:1.{number}"
    interface.mkdir(parents=True)
    (interface / "bInterfaceNumber").write_text(f"0{number}\n")
    for key, value in (("serial", serial), ("idVendor", "1209"), ("idProduct", "5741")):
        (interface.parent / key).write_text(value + "\n")
    (root / "tty" / name).mkdir(parents=True)
    (root / "tty" / name / "device").symlink_to(interface)


def test_without_udev_a_board_is_known_by_its_usb_serial_number_and_interface(tmp_path: Path) -> None:
    usb_tree(tmp_path, "ttyACM0", "A1", "0")
    usb_tree(tmp_path, "ttyACM1", "A1", "2")
    usb_tree(tmp_path, "ttyACM2", "B2", "0")
    dev = tmp_path / "dev"
    dev.mkdir()
    for k in range(3):
        (dev / f"ttyACM{k}").touch()
    finder = Finder(by_id=tmp_path / "none", dev=dev, sys_tty=tmp_path / "tty")
    identities = [finder.identity(dev / f"ttyACM{k}") for k in range(3)]
    assert identities == ["usb:1209:5741:A1:00", "usb:1209:5741:A1:02", "usb:1209:5741:B2:00"]
    assert [finder.find(identity) for identity in identities] == [dev / f"ttyACM{k}" for k in range(3)]
    (tmp_path / "tty" / "ttyACM2" / "device").rename(tmp_path / "moved")
    assert finder.find(identities[2]) is None


def test_ports_say_why_each_is_not_in_use() -> None:
    with tempfile.TemporaryDirectory() as root:  # pytest's own folders are closed to other users
        os.chmod(root, 0o755)
        check_ports(FakeMachine(Path(root)))


def check_ports(machine: FakeMachine) -> None:
    free, forbidden = PtyBoard(machine, PIXHAWK), PtyBoard(machine, "usb-b-if00")
    free.plug("ttyACM0")
    forbidden.plug("ttyACM1")
    os.chmod(forbidden.tty, 0o000)
    finder = Finder(by_id=machine.by_id, dev=machine.dev, sys_tty=machine.finder.sys_tty, proc=machine.dev)
    held = {port.device: port for port in list_ports(machine.finder)}[free.tty]
    assert (held.usable, held.code, held.in_use_by) == (False, "in-use-here", "navdeck itself")
    with ordinary_user():
        ports = {port.device: port for port in list_ports(finder)}
    assert ports[forbidden.tty].code == "no-permission"
    assert not ports[forbidden.tty].usable
    assert "usermod" in ports[forbidden.tty].remedy
    assert ports[free.tty].by_id == str(machine.by_id / PIXHAWK)
    assert ports[free.tty].url == f"serial://{machine.by_id / PIXHAWK}"
    assert ports[free.tty].description == "ArduPilot_Pixhawk6X_1D0030-if00"
    free.unplug()
    forbidden.unplug()


def test_this_machine_can_be_listed() -> None:
    for port in list_ports():
        assert bool(port.code) != port.usable
        assert bool(port.cause) == bool(port.remedy) == bool(port.code)
