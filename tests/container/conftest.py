"""Builds the image and runs it with buildah, podman and runc alone: no engine, no registry of images.

The base image is made here from the Debian packages, under the name that the Dockerfile asks for. It and the layers are
kept in a cache folder outside the tree, so that only the first run is long.
"""

import json
import os
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.conftest import skip_unless_ci

TOOLS = ("buildah", "podman", "runc", "debootstrap", "apt-get")
BASE = "docker.io/library/python:3.11-slim-bookworm"
IMAGE = "localhost/navdeck:test"
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "navdeck-tests" / "container"
CERTIFICATES = Path("/etc/ssl/certs")
RUN_FLAGS = (
    *("--network", "host", "--cgroups=enabled", "--ulimit", "nofile=1024:1024", "--ulimit", "nproc=1024:1024"),
    *("--read-only", "--cap-drop", "all", "--security-opt", "no-new-privileges", "--tmpfs", "/tmp", "--no-healthcheck"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Everything in this folder needs the tools above."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.container)


@dataclass
class Engine:
    """buildah and podman on a storage of their own."""

    folder: Path
    podman_flags: tuple[str, ...] = field(default=("--cgroup-manager", "cgroupfs", "--runtime", "runc"))

    def _storage(self) -> list[str]:
        # podman remembers both folders and refuses others later, so neither may be a temporary one
        return ["--root", f"{self.folder}/store", "--runroot", f"{self.folder}/run", "--storage-driver", "overlay"]

    def buildah(self, *args: str) -> str:
        """Run buildah; a failure shows its own words."""
        return run("buildah", *self._storage(), *args)

    def podman(self, *args: str, check: bool = True) -> str:
        """Run podman; a failure shows its own words, unless it is expected."""
        return run("podman", *self._storage(), *self.podman_flags, *args, check=check)


def run(*command: str, check: bool = True) -> str:
    """Return what the command wrote to both outputs."""
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if check and done.returncode != 0:
        pytest.fail(f"{' '.join(command)}: code {done.returncode}\n{done.stdout[-6000:]}", pytrace=False)
    return done.stdout.strip()


@pytest.fixture(scope="session")
def engine() -> Iterator[Engine]:
    """The tools, where they are and may work."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing or os.geteuid() != 0:
        skip_unless_ci(f"the image cannot be built: no {', '.join(missing) or 'root rights'}")
    CACHE.mkdir(parents=True, exist_ok=True)
    engine = Engine(folder=CACHE)
    yield engine
    engine.podman("rm", "--all", "--force", "--volumes", check=False)
    engine.podman("image", "prune", "--force", "--filter", "until=24h", check=False)  # layers of older trees
    run("umount", f"{CACHE}/store/overlay", check=False)


def debian() -> tuple[str, str]:
    """The mirror and the suite that this machine's own apt uses."""
    release = dict(line.split("=", 1) for line in Path("/etc/os-release").read_text().splitlines() if "=" in line)
    suite = release.get("VERSION_CODENAME", "")
    targets = run("apt-get", "indextargets", "--format", "$(CODENAME) $(REPO_URI)", "Created-By: Packages")
    mirrors = [line.split()[1] for line in targets.splitlines() if line.split()[0] == suite]
    if not mirrors or release.get("ID") != "debian":
        skip_unless_ci("the base image is made of Debian packages, and this is no Debian with a known mirror")
    return mirrors[0], suite


@pytest.fixture(scope="session")
def base(engine: Engine) -> str:
    """A Debian with Python under the name of the Dockerfile's base."""
    if not engine.buildah("images", "--quiet", "--filter", f"reference={BASE}"):
        mirror, suite = debian()
        rootfs = CACHE / "rootfs"
        shutil.rmtree(rootfs, ignore_errors=True)
        packages = "python3,python3-venv,ca-certificates"
        run("debootstrap", "--variant=minbase", f"--include={packages}", suite, str(rootfs), mirror)
        container = engine.buildah("from", "scratch").splitlines()[-1]
        engine.buildah("add", container, str(rootfs), "/")
        engine.buildah("config", "--env", "PATH=/usr/sbin:/usr/bin:/sbin:/bin", container)
        engine.buildah("commit", "--rm", container, BASE)
        shutil.rmtree(rootfs)
    return BASE


@pytest.fixture(scope="session")
def image(engine: Engine, base: str, repository: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The image, built by the Dockerfile as it stands; the machine's certificates and pip settings are lent."""
    npmrc = tmp_path_factory.mktemp("npm") / "npmrc"
    npmrc.write_text(f"cafile={CERTIFICATES}/ca-certificates.crt\n")
    # On the right: where each stands inside the image while it is built.
    lent = {CERTIFICATES: CERTIFICATES, Path("/etc/pip.conf"): Path("/etc/pip.conf"), npmrc: Path("/root/.npmrc")}
    volumes = [f"--volume={here}:{there}:ro" for here, there in lent.items() if here.exists()]
    flags = ("--isolation", "chroot", "--pull=never", "--format", "docker", "--layers", "--build-arg", f"BASE={base}")
    dockerfile = str(repository / "docker" / "Dockerfile")
    engine.buildah("bud", *flags, *volumes, "-f", dockerfile, "-t", IMAGE, str(repository))
    return IMAGE


@dataclass
class Service:
    """A running container, seen from outside."""

    engine: Engine
    name: str
    port: int
    token: str

    def get(self, path: str, token: str | None = None) -> tuple[int, str, bytes]:
        """Return status, content type and body."""
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}")
        if token is not None:
            request.add_header("Authorization", f"Bearer {token}")
        try:
            with urllib.request.urlopen(request, timeout=5) as answer:
                return answer.status, answer.headers.get_content_type(), answer.read()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.headers.get_content_type(), error.read()

    def inspect(self) -> dict[str, object]:
        """The state of the container as podman knows it."""
        state: dict[str, object] = json.loads(self.engine.podman("inspect", self.name))[0]["State"]
        return state

    def wait_until_healthy(self, timeout_s: float = 60.0) -> float:
        """Return the seconds until /healthz answered; fail with the container's log when it never does."""
        start_s = time.monotonic()
        while time.monotonic() - start_s < timeout_s:
            try:
                if self.get("/healthz")[0] == 200:
                    return time.monotonic() - start_s
            except OSError:
                time.sleep(0.1)
        pytest.fail(f"no answer for {timeout_s} s:\n{self.engine.podman('logs', self.name)}", pytrace=False)
