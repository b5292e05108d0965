"""The one door: Host, Origin, role and size of every request and of every WebSocket, before anything else sees it."""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.keyring import Keyring
from server.problems import problem, refuse
from server.wire_base import Problem, Role

SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
GUARDED: Final = ("/api", "/view", "/metrics", "/docs", "/openapi.json")
SESSION_PATH: Final = "/api/v1/session"
MAX_BODY_BYTES: Final = 262_144  # two parameter files of an autopilot
LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "::1"})
SECURITY_HEADERS: Final = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "content-security-policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "worker-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'self'",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Names:
    """By which names the service may be asked for; any other name is one that somebody made point here.

    Attributes:
        loopback: bound to this machine only. Else every address in numbers is allowed too: no one can rebind those.
        allowed: further names; "*" allows any.
    """

    loopback: bool
    bound_host: str
    allowed: tuple[str, ...] = ()
    own: frozenset[str] = field(default_factory=lambda: frozenset({socket.gethostname().lower()}))

    def allow(self, host: str) -> bool:
        """True when a Host header names this service."""
        name = host_name(host)
        if name in LOOPBACK_NAMES or name == self.bound_host.lower() or "*" in self.allowed:
            return True
        if name in {allowed.lower() for allowed in self.allowed}:
            return True
        return not self.loopback and (is_address(name) or name.removesuffix(".local") in self.own)


def host_name(host: str) -> str:
    """Return the name of a Host header without its port, in lower case; "" when it is none."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:
        return ""


def is_address(name: str) -> bool:
    """True when the name is an IP address in numbers."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def same_origin(origin: str, host: str) -> bool:
    """True when an Origin header names the host, port included, that the request was sent to."""
    try:
        parts = urlsplit(origin)
        port = parts.port or {"http": 80, "https": 443}.get(parts.scheme)
        asked = urlsplit(f"//{host}")
        asked_port = asked.port or {"http": 80, "https": 443}.get(parts.scheme)
    except ValueError:
        return False
    return parts.scheme in {"http", "https"} and parts.hostname == asked.hostname and port == asked_port


class Door:
    """ASGI middleware; puts the role into `scope["state"]["role"]`."""

    def __init__(self, app: ASGIApp, keyring: Keyring, names: Names) -> None:
        self._app = app
        self._keyring = keyring
        self._names = names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let in, or refuse with a Problem."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        send = _with_security_headers(send)
        headers = Headers(scope=scope)
        role, found = self._judge(scope, headers)
        if found is not None:
            extra = {"www-authenticate": "Bearer"} if found.status == 401 else {}
            await refuse(found, scope, receive, send, extra | _retry(self._keyring, scope, found))
            return
        scope.setdefault("state", {})["role"] = role
        if scope["type"] == "http" and scope["method"] not in SAFE_METHODS:
            body = await _read_body(headers, receive)
            if body is None:
                detail = f"A request may hold at most {MAX_BODY_BYTES} bytes."
                await refuse(problem(413, "body-too-large", detail, "Send less."), scope, receive, send)
                return
            receive = _replay(body, receive)
        await self._app(scope, receive, send)

    def _judge(self, scope: Scope, headers: Headers) -> tuple[Role | None, Problem | None]:
        """Return the role, and the reason to refuse if there is one."""
        refusal = self._foreign(scope, headers)
        if refusal is not None:
            return None, refusal
        path: str = scope["path"]
        if not path.startswith(GUARDED):
            return None, None  # nobody asks who reads the page itself, so nothing can be guessed here
        if path == SESSION_PATH:
            return self._role(scope, headers), None
        if _bearer(headers) and self._keyring.wait_s(_address(scope)) > 0.0:
            return None, _too_many_guesses()
        role = self._role(scope, headers)
        if role is None:
            detail = "This needs a token."
            remedy = f"Open the page and type it, POST it to {SESSION_PATH}, or send Authorization: Bearer."
            return None, problem(401, "token-needed", detail, remedy)
        if role != "operator" and scope["type"] == "http" and scope["method"] not in SAFE_METHODS:
            return None, problem(
                403, "operator-needed", "A viewer may only look.", "Sign in with the operator's token."
            )
        return role, None

    def _foreign(self, scope: Scope, headers: Headers) -> Problem | None:
        """Refuse a name that is not ours (DNS rebinding), and a page of another origin that acts in our user's name.

        A request without Origin is no page's: every browser sends it on WebSockets and unsafe methods.
        """
        host = headers.get("host", "")
        if not self._names.allow(host):
            remedy = f"Use its address, or allow the name: --allowed-host {host_name(host)[:80] or 'NAME'}."
            return problem(403, "host-not-allowed", f"This service is not called {host[:80]!r}.", remedy)
        if scope["type"] == "http" and scope["method"] in SAFE_METHODS:
            return None
        origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
        if (origin is not None and not same_origin(origin, host)) or site not in {"none", "same-origin"}:
            detail = f"A page of {origin or 'another site'!r} may not act on {host[:80]!r}."
            return problem(403, "origin-not-allowed", detail, "Open the page from this service itself.")
        return None

    def _role(self, scope: Scope, headers: Headers) -> Role | None:
        if self._keyring.is_open:
            return "operator"
        token = _bearer(headers)
        if token:
            return self._keyring.role_of_token(token, _address(scope))
        value = cookie_value(headers)
        return self._keyring.role_of_session(value) if value else None


def cookie_name(host: str) -> str:
    """Return the name of the cookie; it holds the port, because browsers do not keep ports apart."""
    try:
        port = urlsplit(f"//{host}").port
    except ValueError:
        port = None
    return f"navdeck_{port or 'default'}"


def cookie_value(headers: Headers) -> str:
    """Return the value of our cookie; "" when there is none."""
    try:
        cookies = SimpleCookie(headers.get("cookie", ""))
    except CookieError:
        return ""
    morsel = cookies.get(cookie_name(headers.get("host", "")))
    return morsel.value if morsel is not None else ""


def _bearer(headers: Headers) -> str:
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


def _address(scope: Scope) -> str:
    return str((scope.get("client") or ("",))[0])


def _too_many_guesses() -> Problem:
    return problem(429, "too-many-guesses", "Too many wrong tokens came from this address.", "Wait a minute.")


def _retry(keyring: Keyring, scope: Scope, found: Problem) -> dict[str, str]:
    return {"retry-after": str(int(keyring.wait_s(_address(scope))) + 1)} if found.status == 429 else {}


def _with_security_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] in {"http.response.start", "websocket.http.response.start"}:
            headers = MutableHeaders(raw=list(message.get("headers", [])))
            for name, value in SECURITY_HEADERS.items():
                headers.setdefault(name, value)
            message = {**message, "headers": headers.raw}
        await send(message)

    return sending


async def _read_body(headers: Headers, receive: Receive) -> bytes | None:
    """Return the whole body; None when it is larger than allowed."""
    length = headers.get("content-length", "0")
    if not length.isdigit() or int(length) > MAX_BODY_BYTES:
        return None
    body = bytearray()
    while True:
        message = await receive()
        body += message.get("body", b"")
        if len(body) > MAX_BODY_BYTES:
            return None
        if not message.get("more_body", False):
            return bytes(body)


def _replay(body: bytes, receive: Receive) -> Receive:
    parts = [body]

    async def receiving() -> Message:
        return {"type": "http.request", "body": parts.pop(), "more_body": False} if parts else await receive()

    return receiving
