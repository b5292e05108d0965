"""The doctor names what is wrong, why, and what to do."""

import socket
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from server import doctor
from server.doctor import Setup, examine
from server.wire_service import CheckOut, PortOut

PORT = PortOut(
    device="/dev/ttyACM0",
    by_id="",
    description="A board",
    in_use_by="",
    usable=True,
    code="",
    cause="",
    remedy="",
    url="serial:///dev/ttyACM0",
)


@pytest.fixture
def setup(tmp_path: Path) -> Setup:
    return Setup(
        host="127.0.0.1",
        port=0,
        loopback=True,
        insecure=False,
        listening=False,
        token_lengths=(),
        data_dir=tmp_path / "not" / "yet",
        unknown_variables=(),
        list_ports=lambda: (PORT,),
        kernel_modules=("server.nav.constants",),
    )


def check_of(setup: Setup, name: str) -> CheckOut:
    return next(check for check in examine(setup).checks if check.name == name)


def test_a_sound_set_up_has_nothing_to_remedy(setup: Setup, monkeypatch, tmp_path: Path) -> None:
    (tmp_path / "index.html").touch()
    monkeypatch.setattr(doctor, "WEB_DIST", tmp_path)
    report = examine(setup)
    assert [
        check for check in report.checks if check.state == "problem" or (check.remedy and check.state == "ok")
    ] == []
    assert report.state in {"ok", "caution"}  # a full disk of the machine that runs this is not the test's business


def test_a_port_that_is_taken_is_a_problem_unless_it_is_ours(setup: Setup) -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        taken = replace(setup, port=holder.getsockname()[1])
        assert check_of(taken, "port").state == "problem"
        assert f"--port {taken.port + 1}" in check_of(taken, "port").remedy
        assert check_of(replace(taken, listening=True), "port").state == "ok"


@pytest.mark.parametrize(
    ("changes", "state"),
    [
        ({}, "ok"),
        ({"loopback": False}, "problem"),
        ({"loopback": False, "insecure": True}, "caution"),
        ({"loopback": False, "token_lengths": (32,)}, "ok"),
        ({"token_lengths": (32, 8)}, "caution"),
    ],
)
def test_the_door_is_judged_by_who_can_reach_it(setup: Setup, changes: dict[str, object], state: str) -> None:
    assert check_of(replace(setup, **changes), "token").state == state


def test_a_serial_port_that_may_not_be_opened_has_cause_and_remedy(setup: Setup) -> None:
    shut = PORT.model_copy(
        update={"usable": False, "code": "no-permission", "cause": "Not yours.", "remedy": "Join dialout."}
    )
    check = check_of(replace(setup, list_ports=lambda: (shut,)), "port /dev/ttyACM0")
    assert (check.state, check.cause, check.remedy) == ("problem", "Not yours.", "Join dialout.")


def test_no_serial_port_is_only_a_caution(setup: Setup) -> None:
    assert check_of(replace(setup, list_ports=tuple), "serial ports").state == "caution"


def test_an_old_python_a_missing_page_a_missing_part_and_an_old_date_are_found(
    setup: Setup, monkeypatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 10, 0))
    monkeypatch.setattr(doctor, "WEB_DIST", tmp_path)
    monkeypatch.setattr("time.time", lambda: 0.0)
    broken = replace(setup, kernel_modules=("server.no_such_part",), unknown_variables=("NAVDECK_PROT",))
    assert check_of(broken, "python").state == "problem"
    assert check_of(broken, "page").state == "problem"
    assert check_of(broken, "kernels").state == "problem"
    assert check_of(broken, "clock").state == "caution"
    assert check_of(broken, "NAVDECK_PROT").state == "caution"
    assert examine(broken).state == "problem"


def test_a_disk_that_is_full_is_a_problem(setup: Setup, monkeypatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _path: type("Usage", (), {"free": 50_000_000})())
    assert check_of(setup, "data folder").state == "problem"
