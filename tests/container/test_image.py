"""The image as an operator would run it: no root, no capability, nothing writable but /tmp and /data."""

import json
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.container.conftest import RUN_FLAGS, Engine, Service

TOKEN = "a-token-of-the-test"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@pytest.fixture(scope="module")
def service(engine: Engine, image: str) -> Iterator[Service]:
    port, name = free_port(), "navdeck-test"
    engine.podman("rm", "--force", "--volumes", name, check=False)
    env = (f"NAVDECK_TOKEN={TOKEN}", "NAVDECK_HOST=127.0.0.1", f"NAVDECK_PORT={port}")
    flags = [part for value in env for part in ("--env", value)]
    engine.podman("run", "--detach", "--name", name, *RUN_FLAGS, *flags, image)
    running = Service(engine=engine, name=name, port=port, token=TOKEN)
    running.wait_until_healthy()
    yield running
    engine.podman("rm", "--force", "--volumes", name)


def proc_status(service: Service) -> dict[str, str]:
    lines = Path(f"/proc/{service.inspect()['Pid']}/status").read_text().splitlines()
    return {key: value.strip() for key, value in (line.split(":", 1) for line in lines)}


def test_page_and_health_need_no_token_and_boards_do(service: Service) -> None:
    status, kind, body = service.get("/")
    assert (status, kind) == (200, "text/html")
    assert b"<html" in body
    assert service.get("/api/v1/boards")[:2] == (401, "application/problem+json")
    assert service.get("/api/v1/boards", "another")[:2] == (401, "application/problem+json")
    status, kind, body = service.get("/api/v1/boards", TOKEN)
    assert (status, kind) == (200, "application/json")
    assert len(json.loads(body)["boards"]) == 1


def test_process_is_not_root_and_has_no_capability(service: Service) -> None:
    status = proc_status(service)
    assert status["Uid"].split() == ["10001"] * 4
    assert int(status["CapEff"], 16) == 0
    assert status["NoNewPrivs"] == "1"


def test_root_of_the_container_is_read_only(service: Service) -> None:
    mounts = Path(f"/proc/{service.inspect()['Pid']}/mountinfo").read_text().splitlines()
    root = next(line.split() for line in mounts if line.split()[4] == "/")
    assert "ro" in root[5].split(",")


def test_every_kernel_comes_from_the_cache_of_the_image(service: Service) -> None:
    said = service.engine.podman("exec", service.name, "python", "-P", "-m", "server.warm", "--expect-cached")
    cached, compiled = (int(word) for word in said.splitlines()[-1].split() if word.isdecimal())
    assert cached > 10
    assert compiled == 0


def test_healthcheck_of_the_image_passes_while_it_serves(service: Service, image: str) -> None:
    config = json.loads(service.engine.podman("image", "inspect", image))[0]
    kind, *command = config.get("HealthCheck", config.get("Healthcheck"))["Test"]
    assert kind == "CMD"
    service.engine.podman("exec", service.name, *command)


def test_without_a_token_it_refuses_to_be_reachable_and_says_so(engine: Engine, image: str) -> None:
    said = engine.podman("run", "--rm", *RUN_FLAGS, image, check=False)
    assert "NAVDECK_TOKEN" in said


def test_stop_is_clean(service: Service) -> None:
    """Runs last in this file: SIGTERM ends the service by itself, well before the engine would kill it."""
    service.engine.podman("stop", "--time", "10", service.name)
    assert service.inspect()["ExitCode"] == 0
