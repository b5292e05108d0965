"""The page: static files of the built web part, and its places, which all are the one index.html."""

from __future__ import annotations

import gzip
import mimetypes
from functools import lru_cache
from pathlib import Path
from typing import Final

from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from server.api.errors import REMEDIES, no_such_socket
from server.problems import problem, problem_response

WEB_DIST: Final = Path(__file__).resolve().parents[1] / "web_dist"
PLACES: Final = frozenset({"", "live", "sensors", "estimators", "calibrate", "logs", "board"})
COMPRESSIBLE: Final = ("text/", "application/javascript", "application/json", "image/svg", "application/wasm")
NOT_BUILT: Final = """<!doctype html><html lang="en"><meta charset="utf-8"><title>navdeck</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>body{font:16px system-ui;margin:3rem auto;
max-width:40rem;padding:0 1rem;color-scheme:light dark}</style><h1>navdeck runs, its page was not built</h1>
<p>The API works: <a href="docs">docs</a>. To have the page, run <code>./run</code> in the checkout, or
<code>npm ci &amp;&amp; npm run build</code> in <code>web/</code>, and load this again.</p></html>"""


@lru_cache(maxsize=128)
def _content(file: Path, _stamp_ns: int, *, zipped: bool) -> bytes:
    data = file.read_bytes()
    return gzip.compress(data, 6, mtime=0) if zipped else data


def _file_of(root: Path, path: str) -> Path | None:
    """Return the file below the root, index.html for a place; None when there is none."""
    name = "index.html" if path.strip("/") in PLACES else path
    file = (root / name.lstrip("/")).resolve()
    return file if file.is_relative_to(root.resolve()) and file.is_file() else None


def page_response(root: Path, path: str, accept_encoding: str) -> Response | None:
    """Return a file of the page; None when there is no such file."""
    file = _file_of(root, path)
    if file is None:
        return None
    media_type = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    zipped = "gzip" in accept_encoding and media_type.startswith(COMPRESSIBLE)
    named_by_content = file.parent.name == "assets"
    headers = {"cache-control": "public, max-age=31536000, immutable" if named_by_content else "no-cache"}
    if media_type.startswith(COMPRESSIBLE):
        headers |= {"vary": "accept-encoding"} | ({"content-encoding": "gzip"} if zipped else {})
    return Response(_content(file, file.stat().st_mtime_ns, zipped=zipped), 200, headers, media_type)


async def page_or_404(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer what no route answers: a file of the page, one of its places, or a Problem."""
    if scope["type"] == "websocket":
        await no_such_socket(scope, receive, send)
        return
    await _answer(scope["method"], scope["path"], Headers(scope=scope))(scope, receive, send)


def _answer(method: str, path: str, headers: Headers) -> Response:
    found = page_response(WEB_DIST, path.lstrip("/"), headers.get("accept-encoding", "")) if _may_be(path) else None
    if found is None and path.strip("/") in PLACES:
        found = Response(NOT_BUILT, media_type="text/html")
    if found is None:
        return problem_response(problem(404, "not-found", f"There is nothing at {path[:200]}.", REMEDIES[404]))
    if method not in {"GET", "HEAD"}:
        body = problem(405, "method-not-allowed", f"{path[:200]} can only be read.", REMEDIES[405])
        return problem_response(body, {"allow": "GET, HEAD"})
    return found


def _may_be(path: str) -> bool:
    return "\0" not in path and not path.startswith("/api/")
