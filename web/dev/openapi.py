"""Write web/openapi.json, from which the page's types are made; with --check only compare it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from server.app import bare_app

TARGET = Path(__file__).parents[1] / "openapi.json"


def main() -> None:
    """Exit with 1 and say what to do when the file and the service's bodies differ."""
    text = json.dumps(bare_app().openapi(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"
    if "--check" not in sys.argv[1:]:
        TARGET.write_text(text, encoding="utf-8")
    elif not TARGET.exists() or TARGET.read_text(encoding="utf-8") != text:
        sys.exit("web/openapi.json is not what the service says: run `python web/dev/openapi.py && npm run types`")


if __name__ == "__main__":
    main()
