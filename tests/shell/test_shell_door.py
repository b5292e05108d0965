"""Who may enter: Host, Origin, tokens, cookies, guesses and sizes, over HTTP and in the handshake of WebSockets."""

import itertools
from collections.abc import AsyncIterator

import httpx
import pytest
from websockets.exceptions import InvalidStatus

from server.app import serve
from server.door import MAX_BODY_BYTES, Names, same_origin
from server.keyring import GUESS_WINDOW_S, GUESSES, MAX_SESSIONS, SESSION_S, Keyring
from server.listener import StartError
from tests.shell.shell_fakes import Running, fake_settings, running

TOKEN, VIEWER = "operator-token-0123456789", "viewer-token-0123456789"
WITH_TOKENS = {"token": TOKEN, "viewer_token": VIEWER}
GUARDED = ["/api/v1/info", "/api/v1/boards", "/api/v1/boards/sim/nav", "/metrics", "/docs", "/openapi.json", "/view/"]
OPEN = ["/", "/live", "/healthz", "/readyz"]


def bearer(token: str) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"}


def assert_problem(response: httpx.Response, status: int, code: str) -> None:
    body = response.json()
    assert (response.status_code, body["status"], body["code"]) == (status, status, code)
    assert response.headers["content-type"] == "application/problem+json"
    assert body["type"] == f"urn:navdeck:problem:{code}"
    assert body["title"]
    assert body["detail"]


async def handshake_status(run: Running, **headers: str) -> tuple[int, str]:
    """The status and body of a refused handshake; 101 when it was accepted."""
    try:
        async with run.stream(additional_headers=headers):
            return 101, ""
    except InvalidStatus as error:
        return error.response.status_code, error.response.body.decode()


async def test_without_tokens_everybody_on_this_machine_is_an_operator() -> None:
    async with running() as run:
        info = (await run.client.get("/api/v1/info")).json()
        assert (info["role"], info["auth_required"]) == ("operator", False)


@pytest.mark.parametrize("path", GUARDED)
async def test_with_tokens_what_shows_or_does_anything_needs_one(path: str) -> None:
    async with running(fake_settings(**WITH_TOKENS)) as run:
        response = await run.client.get(path)
        assert_problem(response, 401, "token-needed")
        assert response.headers["www-authenticate"] == "Bearer"


@pytest.mark.parametrize("path", OPEN)
async def test_with_tokens_the_page_and_the_probes_are_still_served(path: str) -> None:
    async with running(fake_settings(**WITH_TOKENS)) as run:
        assert (await run.client.get(path)).status_code == 200


async def test_a_viewer_looks_and_an_operator_acts() -> None:
    async with running(fake_settings(**WITH_TOKENS)) as run:
        for token, role in ((VIEWER, "viewer"), (TOKEN, "operator")):
            assert (await run.client.get("/api/v1/info", headers=bearer(token))).json()["role"] == role
        refused = await run.client.post("/api/v1/boards/sim/reconnect", headers=bearer(VIEWER))
        assert_problem(refused, 403, "operator-needed")
        assert (await run.client.delete("/api/v1/boards/sim", headers=bearer(VIEWER))).status_code == 403
        assert (await run.client.post("/api/v1/boards/sim/reconnect", headers=bearer(TOKEN))).status_code == 202


async def test_a_token_becomes_a_cookie_that_scripts_and_other_sites_never_see() -> None:
    async with running(fake_settings(**WITH_TOKENS)) as run:
        response = await run.client.post("/api/v1/session", json={"token": VIEWER})
        cookie = response.headers["set-cookie"]
        assert response.json()["role"] == "viewer"
        assert "HttpOnly" in cookie
        assert "samesite=strict" in cookie.lower()
        assert VIEWER not in cookie
        assert (await run.client.get("/api/v1/info")).json()["role"] == "viewer"
        assert (await run.client.delete("/api/v1/session")).status_code == 204
        run.client.cookies.clear()
        name, value = cookie.split(";")[0].split("=")
        again = await run.client.get("/api/v1/info", headers={"cookie": f"{name}={value}"})
        assert_problem(again, 401, "token-needed")


async def test_the_cookie_opens_the_stream_and_nothing_else_does(caplog: pytest.LogCaptureFixture) -> None:
    async with running(fake_settings(**WITH_TOKENS)) as run:
        await run.client.post("/api/v1/session", json={"token": VIEWER})
        cookie = "; ".join(f"{name}={value}" for name, value in run.client.cookies.items())
        assert (await handshake_status(run, cookie=cookie))[0] == 101
        assert (await handshake_status(run, **bearer(VIEWER)))[0] == 101
        status, body = await handshake_status(run)
        assert status == 401
        assert '"code":"token-needed"' in body
        assert [record.msg for record in caplog.records if record.levelname == "ERROR"] == []


async def test_a_wrong_token_is_a_problem_and_many_are_not_even_looked_at() -> None:
    async with running(fake_settings(**WITH_TOKENS)) as run:
        for _ in range(GUESSES):
            assert_problem(await run.client.post("/api/v1/session", json={"token": "guess"}), 401, "wrong-token")
        right_but_late = await run.client.post("/api/v1/session", json={"token": TOKEN})
        assert_problem(right_but_late, 429, "too-many-guesses")
        by_header = await run.client.get("/api/v1/info", headers=bearer(TOKEN))
        assert_problem(by_header, 429, "too-many-guesses")
        assert 0 < int(by_header.headers["retry-after"]) <= GUESS_WINDOW_S + 1


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "192.168.1.5", ""])
async def test_a_name_that_is_not_ours_is_refused_so_that_no_site_can_rebind_to_us(host: str) -> None:
    async with running() as run:
        assert_problem(await run.client.get("/api/v1/boards", headers={"host": host}), 403, "host-not-allowed")
        assert (await run.client.get("/", headers={"host": host})).status_code == 403


async def test_an_allowed_name_is_let_in() -> None:
    async with running(fake_settings(allowed_hosts=("drone.example",))) as run:
        assert (await run.client.get("/api/v1/boards", headers={"host": "Drone.Example:80"})).status_code == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1", "file://"]
)
async def test_a_foreign_page_can_neither_act_nor_listen(origin: str) -> None:
    async with running() as run:
        refused = await run.client.post("/api/v1/boards/sim/reconnect", headers={"origin": origin})
        assert_problem(refused, 403, "origin-not-allowed")
        status, body = await handshake_status(run, origin=origin)
        assert status == 403
        assert "origin-not-allowed" in body


async def test_our_own_page_may_act_and_listen() -> None:
    async with running() as run:
        headers = {"origin": run.url, "sec-fetch-site": "same-origin"}
        assert (await run.client.post("/api/v1/boards/sim/reconnect", headers=headers)).status_code == 202
        assert (await handshake_status(run, origin=run.url))[0] == 101


async def test_a_browser_that_hides_the_origin_but_says_cross_site_is_refused() -> None:
    async with running() as run:
        response = await run.client.delete("/api/v1/boards/sim", headers={"sec-fetch-site": "cross-site"})
        assert_problem(response, 403, "origin-not-allowed")


async def test_a_body_beyond_the_limit_is_refused_said_or_unsaid() -> None:
    async def endless() -> AsyncIterator[bytes]:
        for _ in range(100):
            yield b"x" * 4096

    async with running() as run:
        assert_problem(
            await run.client.post("/api/v1/boards", content=b"x" * (MAX_BODY_BYTES + 1)), 413, "body-too-large"
        )
        assert_problem(await run.client.post("/api/v1/boards", content=endless()), 413, "body-too-large")


async def test_a_socket_that_does_not_exist_is_a_404_problem() -> None:
    async with running() as run:
        run.url = run.url + "/nowhere"
        status, body = await handshake_status(run)
        assert status == 404
        assert '"code":"not-found"' in body


async def test_every_answer_forbids_sniffing_and_foreign_frames() -> None:
    async with running() as run:
        for path in ("/", "/api/v1/boards", "/nothing"):
            headers = (await run.client.get(path)).headers
            assert headers["x-content-type-options"] == "nosniff"
            assert "frame-ancestors 'self'" in headers["content-security-policy"]


def test_bound_to_a_network_addresses_in_numbers_are_allowed_and_foreign_names_not() -> None:
    names = Names(loopback=False, bound_host="0.0.0.0", own=frozenset({"bench"}))
    assert [names.allow(host) for host in ("192.168.1.5:8080", "[fe80::1]:8080", "bench", "bench.local")] == [True] * 4
    assert not names.allow("evil.example")


@pytest.mark.parametrize(
    ("origin", "host", "same"),
    [
        ("http://a", "a", True),
        ("http://a:80", "a", True),
        ("https://a", "a:443", True),
        ("http://a:8080", "a:8080", True),
        ("http://a:8080", "a:8081", False),
        ("http://b", "a", False),
        ("http://a:x", "a", False),
        ("null", "", False),
        ("http://[::1]:8080", "[::1]:8080", True),
    ],
)
def test_an_origin_is_the_same_when_host_and_port_are(origin: str, host: str, same: bool) -> None:
    assert same_origin(origin, host) is same


def test_sessions_end_by_themselves_and_are_bounded() -> None:
    now = itertools.count(0.0, SESSION_S / 2)
    keyring = Keyring("a", None, clock_s=lambda: next(now))
    first = keyring.open_session("operator")
    assert keyring.role_of_session(first) == "operator"
    assert keyring.role_of_session(first) is None
    still = Keyring("a", None, clock_s=lambda: 0.0)
    values = [still.open_session("viewer") for _ in range(MAX_SESSIONS + 1)]
    assert [still.role_of_session(value) for value in (values[0], values[1])] == [None, "viewer"]


def test_the_same_token_for_both_roles_is_refused_at_the_start() -> None:
    with pytest.raises(StartError, match="are the same"):
        serve(fake_settings(host="0.0.0.0", token="a-secret", viewer_token="a-secret"))
