"""viser's browser client as we serve it: one file, with our camera, colours and manners put in."""

from __future__ import annotations

import gzip
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from server.view3d import palette
from server.view3d.camera import FAR_M, FOV_RAD, NEAR_M, PLAIN_SPAN_M, Camera, place_m
from server.view3d.paths import PathColour
from server.view3d.studio_layout import PLAIN_ASPECT, camera_place

SOCKET_PATH: Final = "/view"
CSP: Final = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; worker-src blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; connect-src 'self' blob: data:; font-src data:; frame-ancestors 'self'"
)
"""viser's client evaluates its own inlined bundle and decoders; nothing of it may come from, or go, anywhere else."""

# viser shows its panel as a floating window, and on narrow screens as a bottom sheet: only the picture may be seen.
_STYLE: Final = (
    "body *{{visibility:hidden!important}}body canvas[data-engine]{{visibility:visible!important}}"
    "body,canvas[data-engine]{{background:{light}!important}}"
    "html[data-theme=dark] :is(body,canvas[data-engine]){{background:{dark}!important}}"
)


@dataclass(frozen=True, slots=True)
class ViewPage:
    """The document, plain and compressed, with its entity tag."""

    html: bytes
    gzipped: bytes
    etag: str


def build_page(client_html: Path) -> ViewPage:
    """Return viser's client with our style and script before everything of its own. Takes about 50 ms: once."""
    source = client_html.read_text(encoding="utf-8")
    at = source.index("</title>") + len("</title>")
    html = (source[:at] + _injection() + source[at:]).encode()
    return ViewPage(html, gzip.compress(html, 6), f'"{hashlib.sha256(html).hexdigest()[:20]}"')


def _injection() -> str:
    script = Path(__file__).with_name("inject.js").read_text(encoding="utf-8")
    style = _STYLE.format(**palette.SKY_CSS)
    return f"<style>{style}</style><script>{script.replace('__NAVDECK_CONFIG__', json.dumps(_config()))}</script>"


def _config() -> dict[str, object]:
    places = {camera: place_m(camera, PLAIN_SPAN_M) for camera in Camera}
    studio = camera_place(1, PLAIN_ASPECT)
    return {
        "cameras": {camera: {"position": position, "target": target} for camera, (position, target) in places.items()},
        "studio": {"position": studio[0], "target": studio[1]},
        "colors": list(PathColour),
        "fov": round(FOV_RAD, 5),
        "near": NEAR_M,
        "far": FAR_M,
        "path": SOCKET_PATH,
    }
