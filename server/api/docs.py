"""The reference at /docs, drawn from OpenAPI without scripts and without any other host: it also works in the field."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Final

from fastapi import APIRouter, Request, Response

from server.api.openapi import REF, Json

router = APIRouter(include_in_schema=False)
STYLE: Final = """body{font:16px/1.5 system-ui;max-width:60rem;margin:2rem auto;padding:0 1rem;color-scheme:light dark}
code,.m{font-family:ui-monospace,monospace}.m{display:inline-block;min-width:4.5rem;font-weight:600}
details{border-top:1px solid #8884;padding:.5rem 0}summary{cursor:pointer}table{border-collapse:collapse;margin:.5rem 0}
td,th{text-align:left;vertical-align:top;padding:.15rem 1rem .15rem 0}th{font-weight:600}"""
STREAM_TEXT: Final = """<h2 id="stream">WebSocket /api/v1/stream</h2>
<p>Text messages are JSON: SubscribeIn, UnsubscribeIn and PingIn to the server; SubscribedOut, StreamErrorOut, PongOut,
TickOut and DataOut from it. Binary messages are rows, little-endian: uint8 version (1), uint8 id, uint16 n_rows,
uint16 n_cols, uint16 boot_id, then n_rows times (float64 t_ns, n_cols float64); unknown is NaN. A rate below the
topic's own gives the first row of each period (of onboard and reference one with attitude and one with position, which
come in rows of their own); at or above it every row. GET /api/v1/boards names every board's topics with their
columns.</p>"""


@router.get("/docs")
async def get_docs(request: Request) -> Response:
    """Return the reference."""
    schema = request.app.openapi()
    parts = [*_operations(schema), STREAM_TEXT, "<h2>Bodies</h2>", *_bodies(schema)]
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>navdeck API</title><style>{STYLE}</style>'
    title = f"<h1>navdeck API {escape(schema['info']['version'])}</h1><p><a href='openapi.json'>openapi.json</a></p>"
    return Response(f"{head}{title}{''.join(parts)}</html>", media_type="text/html")


def _operations(schema: Json) -> Iterator[str]:
    yield "<h2>Addresses</h2>"
    for path, operations in schema["paths"].items():
        for method, operation in operations.items():
            yield (
                f"<details><summary><span class=m>{method.upper()}</span> <code>{escape(path)}</code></summary>"
                f"<p>{escape(operation.get('description', ''))}</p>"
                f"{_parameters(operation)}{_answers(operation)}</details>"
            )


def _parameters(operation: Json) -> str:
    rows = [
        f"<tr><td><code>{escape(one['name'])}</code></td><td>{escape(one['in'])}</td>"
        f"<td>{_type(one['schema'])}</td><td>{escape(one.get('description', ''))}</td></tr>"
        for one in operation.get("parameters", [])
    ]
    body = operation.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema")
    if body:
        rows.append(f"<tr><td>body</td><td></td><td>{_type(body)}</td><td></td></tr>")
    return f"<table>{''.join(rows)}</table>" if rows else ""


def _answers(operation: Json) -> str:
    def content(response: Json) -> str:
        return ", ".join(f"{_type(body.get('schema', {}))}" for body in response.get("content", {}).values())

    rows = (f"<tr><td>{status}</td><td>{content(one)}</td></tr>" for status, one in operation["responses"].items())
    return f"<table><tr><th>Status</th><th>Body</th></tr>{''.join(rows)}</table>"


def _bodies(schema: Json) -> Iterator[str]:
    for name, body in sorted(schema["components"]["schemas"].items()):
        rows = (
            f"<tr><td><code>{escape(key)}</code></td><td>{_type(field)}</td>"
            f"<td>{escape(field.get('description', ''))}</td></tr>"
            for key, field in body.get("properties", {}).items()
        )
        text = escape(body.get("description", "").split("\n\n")[0])
        yield f'<details id="{name}"><summary>{name}</summary><p>{text}</p><table>{"".join(rows)}</table></details>'


def _type(field: Json) -> str:
    """Return a type in words; a body is a link to it."""
    if "$ref" in field:
        name = field["$ref"].removeprefix(REF)
        return f'<a href="#{name}">{name}</a>'
    if "anyOf" in field:
        return " or ".join(_type(one) for one in field["anyOf"])
    if "enum" in field or "const" in field:
        return escape(" | ".join(map(str, field.get("enum", [field.get("const")]))))
    if field.get("type") == "array":
        return f"list of {_type(field.get('items', {}))}"
    return escape(str(field.get("type", "any")))
