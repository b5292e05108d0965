"""The installed program as processes: a server whose CPU time can be read, and an emulated board."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

NAVDECK = Path(sys.executable).with_name("navdeck")


class Server:
    """One `navdeck serve`, timed from its start."""

    def __init__(self, folder: Path, link: str) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        clean = {name: value for name, value in os.environ.items() if not name.startswith("NAVDECK_")}
        env = {**clean, "NAVDECK_DATA_DIR": str(folder / "data")}
        command = [str(NAVDECK), "serve", "--port", str(self.port), "--link", link]
        self.began_s = time.monotonic()
        with (folder / "log").open("ab") as log:
            self.process = subprocess.Popen(command, env=env, cwd=folder, stdout=log, stderr=log)

    def wait(self) -> float:
        """Return the seconds from the start of the process until page and readiness are there."""
        while not (self.has("/") and self.has("/readyz")):
            if self.process.poll() is not None or time.monotonic() - self.began_s > 60:
                raise SystemExit("navdeck serve did not start; try it by hand")
            time.sleep(0.02)
        return time.monotonic() - self.began_s

    def has(self, path: str) -> bool:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=2) as answer:
                return bool(answer.status == 200 and answer.read())
        except OSError:
            return False

    def board(self) -> dict[str, object]:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/api/v1/boards", timeout=5) as answer:
            return dict(json.load(answer)["boards"][0])

    def health(self) -> dict[str, Any]:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/api/v1/boards/board/health", timeout=5) as answer:
            return dict(json.load(answer))

    def cpu_s(self) -> float:
        """CPU time of every thread so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def percent(self, seconds: float, windows: int) -> list[float]:
        """Shares of a core used in each window."""
        shares = []
        for _ in range(windows):
            cpu_s, begin_s = self.cpu_s(), time.monotonic()
            time.sleep(seconds / windows)
            shares.append(100.0 * (self.cpu_s() - cpu_s) / (time.monotonic() - begin_s))
        return shares

    def stop(self) -> None:
        end(self.process)


def end(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def wait_for(what: str, holds: Callable[[], object], time_s: float = 60.0) -> None:
    until_s = time.monotonic() + time_s
    while not holds():
        if time.monotonic() > until_s:
            raise SystemExit(f"{what}: not within {time_s:g} s")
        time.sleep(0.1)


@contextlib.contextmanager
def emulated_board(log: Path, folder: Path) -> Iterator[str]:
    """Run `navdeck emulate` and give the URL of its terminal."""
    link = folder / "board"
    command = [str(NAVDECK), "emulate", str(log), "--now", "--loop", "--link", str(link)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_for("the emulated board", link.is_symlink)
        yield f"serial://{link}?baud=921600"
    finally:
        end(process)


@contextlib.contextmanager
def serving(folder: Path, link: str) -> Iterator[Server]:
    server = Server(folder, link)
    try:
        server.wait()
        yield server
    finally:
        server.stop()
