"""The command as a person runs it: its own process, its texts and its exit status."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import pytest

NAVDECK = [sys.executable, "-m", "server.cli"]
LISTENING = re.compile(r"http://127\.0\.0\.1:\d+")
QUIET = ["--no-view3d", "--link", "tcp-listen://127.0.0.1:0"]


def run(*args: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*NAVDECK, *args], capture_output=True, text=True, timeout=60, env={**os.environ, **variables}, check=False
    )


@pytest.fixture
def served() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A service in its own process and its URL."""
    command = [*NAVDECK, "--port", "0", *QUIET]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        url = ""
        for line in process.stderr:
            if found := LISTENING.search(line):
                url = found[0]
                break
        yield process, url
        process.kill()


def test_the_version_is_the_packages() -> None:
    done = run("--version")
    assert (done.returncode, done.stdout) == (0, f"navdeck {version('navdeck')}\n")


def test_the_help_names_every_command() -> None:
    text = run("--help").stdout
    assert all(f"  {name} " in text for name in ("serve", "ports", "emulate", "replay", "doctor"))


def test_the_help_of_serve_has_every_setting_with_its_default() -> None:
    from server.settings import Settings, flag_of

    text = run("serve", "--help", COLUMNS="200").stdout
    assert [flag for flag in map(flag_of, Settings.model_fields) if f"{flag} " not in text] == []
    assert "[8080]" in text
    assert "[50 Hz]" in text


def test_without_a_command_it_serves_and_a_signal_ends_it_with_status_0(served) -> None:
    process, url = served
    with urllib.request.urlopen(url + "/readyz", timeout=10) as response:
        assert response.status == 200
    process.send_signal(signal.SIGTERM)
    assert process.wait(10) == 0
    assert "Traceback" not in process.stderr.read()


@pytest.mark.parametrize("after_s", [0.3, 0.6, 0.9, 1.2])
def test_a_signal_while_it_starts_ends_it_without_a_traceback(after_s: float) -> None:
    with subprocess.Popen([*NAVDECK, "--port", "0", *QUIET], stderr=subprocess.PIPE, text=True) as process:
        time.sleep(after_s)
        process.send_signal(signal.SIGTERM)
        process.wait(10)
        assert process.returncode in {0, -signal.SIGTERM}  # the latter: before Python ran a line of ours
        assert process.stderr is not None
        assert "Traceback" not in process.stderr.read()


def test_a_port_in_use_is_said_with_the_remedy(served) -> None:
    port = served[1].rsplit(":", 1)[1]
    done = run("--port", port, *QUIET)
    assert done.returncode == 1
    assert f"127.0.0.1:{port} cannot be used: Address already in use" in done.stderr
    assert f"--port {int(port) + 1}" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("args", "named"),
    [
        (["--port", "99999"], "port = '99999'"),
        (["--host", "0.0.0.0"], "NAVDECK_TOKEN"),
        (["--host", "::"], "NAVDECK_TOKEN"),
        (["--host", "no.such.host.invalid", "--insecure"], "no.such.host.invalid"),
        (["--link", "bogus"], "'bogus' is not a link"),
        (["--link", "sim:", "--link", "sim:"], "already uses this link"),
        (["--lane", "nothing", *QUIET], "nothing"),
        (["--lane-parameter", "nothing.x=1", *QUIET], "no lane called nothing"),
        (["--lane-parameter", "ins_ekf.no_such_thing=1", *QUIET], "no parameter no_such_thing"),
        (["--lane-parameter", "ins_ekf", *QUIET], "LANE.PARAMETER=VALUE"),
        (["--config", "absent.toml"], "absent.toml"),
        (["serve", "--nav-rate-hz", "0"], "nav_rate_hz"),
        (["emulate", "absent.tlog"], "absent.tlog"),
        (["emulate", "absent.tlog", "--speed", "-1"], "-1"),
        (["replay", "absent.tlog", "--out", "out"], "absent.tlog"),
        (["doctor", "--port", "-3"], "-3"),
    ],
)
def test_what_cannot_be_is_refused_with_status_2_and_without_a_traceback(args: list[str], named: str) -> None:
    done = run(*args)
    assert done.returncode == 2
    assert named in done.stderr
    assert "Traceback" not in done.stderr


def test_a_network_is_served_with_a_token_and_only_then() -> None:
    command = [*NAVDECK, "--host", "0.0.0.0", "--port", "0", *QUIET]
    environment = {**os.environ, "NAVDECK_TOKEN": "a-token-for-this-test"}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stderr is not None
        url = next(found[0] for line in process.stderr if (found := LISTENING.search(line)))
        request = urllib.request.Request(
            url + "/api/v1/info", headers={"authorization": "Bearer a-token-for-this-test"}
        )
        with urllib.request.urlopen(request, timeout=10) as response:
            assert b'"operator"' in response.read()
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0


def test_the_doctor_finds_the_port_taken_and_says_so_with_status_1() -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        port = str(holder.getsockname()[1])
        done = run("doctor", "--port", port)
    assert done.returncode == 1
    assert re.search(rf"PROBLEM\s+port: 127\.0\.0\.1:{port} cannot be used", done.stdout)
    assert "→ Stop the program" in done.stdout


def test_emulate_says_the_terminal_it_made(shared_data: Path) -> None:
    log = shared_data / "ardupilot_sitl" / "static.tlog"
    with subprocess.Popen([*NAVDECK, "emulate", str(log)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        device = process.stdout.readline().strip()
        assert Path(device).is_char_device()
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 0


def test_a_token_that_can_be_guessed_is_warned_of_without_being_shown() -> None:
    command = [*NAVDECK, "--port", "0", *QUIET]
    environment = {**os.environ, "NAVDECK_TOKEN": "guess-me", "NAVDECK_VIEWER_TOKEN": "x" * 16}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stderr is not None
        lines = []
        for line in process.stderr:
            lines.append(line)
            if LISTENING.search(line):
                break
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0
    warnings = [line for line in lines if "can be guessed" in line]
    assert len(warnings) == 1
    assert "the token has fewer than 16 characters" in warnings[0]
    assert "guess-me" not in "".join(lines)
