"""OpenAPI, with what FastAPI cannot know of it; `python -m server.api.openapi` prints it for the page's types."""

from __future__ import annotations

import json
import sys
from typing import Any, Final

from fastapi import FastAPI
from pydantic.json_schema import JsonSchemaMode

from server.wire_stream import (
    DataOut,
    PingIn,
    PongOut,
    StreamErrorOut,
    SubscribedOut,
    SubscribeIn,
    TickOut,
    UnsubscribeIn,
)

Json = dict[str, Any]
REF: Final = "#/components/schemas/"
STREAM_BODIES: Final = (SubscribeIn, UnsubscribeIn, PingIn, SubscribedOut, StreamErrorOut, PongOut, TickOut, DataOut)


def openapi_of(app: FastAPI) -> Json:
    """Return OpenAPI with two facts FastAPI cannot know: errors are problem+json, and the stream has bodies too."""
    if app.openapi_schema is not None:
        return app.openapi_schema
    schema = FastAPI.openapi(app)
    for operation in (op for path in schema["paths"].values() for op in path.values()):
        for status, response in operation["responses"].items():
            content = response.get("content", {})
            if int(status) >= 400 and "application/json" in content:
                content["application/problem+json"] = content.pop("application/json")
    for body in STREAM_BODIES:
        mode: JsonSchemaMode = "validation" if body.__name__.endswith("In") else "serialization"
        own: Json = body.model_json_schema(ref_template=REF + "{model}", mode=mode)
        schema["components"]["schemas"] = own.pop("$defs", {}) | schema["components"]["schemas"] | {body.__name__: own}
    app.openapi_schema = schema
    return schema


def main() -> None:
    """Print the schema, the same on every machine."""
    from server.app import bare_app

    sys.stdout.write(json.dumps(bare_app().openapi(), indent=2, sort_keys=True, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
