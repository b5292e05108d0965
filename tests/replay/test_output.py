"""The output directory: whole or not at all, and nobody else's files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from server.replay.errors import ReplayError
from server.replay.output import Output

OURS = {"format": "navdeck.replay.summary/1", "lanes": {"a": {"file": "a.csv"}, "b": {"file": "b.csv"}}}
LOG = Path("some.tlog")


def written(place: Path, names: dict[str, bytes], *, overwrite: bool = False) -> None:
    with Output(place, LOG, overwrite=overwrite) as output:
        for name, data in names.items():
            output.write(name, data)
        output.commit()


def names(place: Path) -> set[str]:
    return {path.name for path in place.iterdir()}


def test_a_new_directory_appears_with_its_parents(tmp_path: Path) -> None:
    written(tmp_path / "a" / "b", {"a.csv": b"1", "summary.json": b"{}"})
    assert names(tmp_path / "a" / "b") == {"a.csv", "summary.json"}
    assert names(tmp_path / "a") == {"b"}


def test_a_failure_halfway_leaves_the_place_as_it_was(tmp_path: Path) -> None:
    place = tmp_path / "out"
    written(place, {"a.csv": b"old", "summary.json": json.dumps(OURS).encode()})
    with Output(place, LOG) as output:
        output.write("a.csv", b"new")  # and never committed, as after an error
    assert (place / "a.csv").read_bytes() == b"old"
    assert names(tmp_path) == {"out"}


def test_an_earlier_replay_is_replaced_but_not_what_a_person_put_beside_it(
    tmp_path: Path,
) -> None:
    place = tmp_path / "out"
    written(place, {"a.csv": b"old", "b.csv": b"old", "summary.json": json.dumps(OURS).encode()})
    (place / "plot.png").write_bytes(b"mine")
    written(place, {"a.csv": b"new", "summary.json": json.dumps(OURS).encode()})
    assert names(place) == {"a.csv", "summary.json", "plot.png"}
    assert (place / "a.csv").read_bytes() == b"new"


@pytest.mark.parametrize("summary", [b"{}", b"not json", b'{"format": "other", "lanes": {}}', b"[]"])
def test_a_directory_of_somebody_else_is_refused_unless_told(tmp_path: Path, summary: bytes) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "summary.json").write_bytes(summary)
    with pytest.raises(ReplayError, match="is not empty and holds no earlier replay"):
        Output(tmp_path, LOG)
    written(tmp_path, {"a.csv": b"1"}, overwrite=True)
    assert names(tmp_path) == {"notes.txt", "summary.json", "a.csv"}


def test_a_summary_that_names_files_outside_removes_nothing_outside(tmp_path: Path) -> None:
    victim = tmp_path / "victim.csv"
    victim.write_text("mine")
    bad = {"format": "navdeck.replay.summary/1", "lanes": {"a": {"file": "../victim.csv"}, "b": {"file": ".."}}}
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "summary.json").write_text(json.dumps(bad))
    written(tmp_path / "out", {"a.csv": b"1", "summary.json": b"{}"})
    assert victim.read_text() == "mine"


def test_the_log_itself_is_never_written_into(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    with pytest.raises(ReplayError, match=r"is the log itself: its reference\.csv would be lost"):
        Output(tmp_path / "below" / "..", tmp_path, overwrite=True)


def test_a_place_that_cannot_be_a_directory_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(ReplayError, match=r"is a file\. Give --out a directory"):
        Output(tmp_path / "file", LOG)
    with pytest.raises(ReplayError, match="cannot be written"), Output(tmp_path / "file" / "below", LOG):
        pass
