"""A damaged store never prevents a start: it is put aside, said, and what can be read is taken over."""

import os
import sqlite3

import pytest

from server.calibration.store import CalibrationStore
from server.calibration.store_file import NAME
from server.nav.calibration.types import Sensor
from tests.calibration.store_sets import BOARD, code_of, mag_set


@pytest.fixture
def store(tmp_path):
    made = CalibrationStore(tmp_path / "calibration")
    yield made
    made.close()


def filled(folder, count=60):
    store = CalibrationStore(folder)
    ids = [store.add(mag_set(number)).id for number in range(count)]
    store.apply(BOARD, ids[-1], "operator")
    store.close()
    return ids


@pytest.mark.parametrize("size", [1, 100, 4096, 20000])
def test_a_truncated_store_is_put_aside_whole_and_a_new_one_works(tmp_path, size):
    filled(tmp_path)
    os.truncate(tmp_path / NAME, size)
    damaged = (tmp_path / NAME).read_bytes()
    store = CalibrationStore(tmp_path)
    (trouble,) = store.troubles
    (aside,) = tmp_path.glob("damaged-*.sqlite3")
    assert aside.name in trouble
    assert aside.read_bytes() == damaged
    store.apply(BOARD, store.add(mag_set(7)).id, "operator")
    assert CalibrationStore(tmp_path).troubles == []


@pytest.mark.parametrize(
    "garbage", [b"not a database at all", bytes(range(256)) * 64, b"SQLite format 3\0" + b"\xff" * 9000]
)
def test_garbage_in_place_of_the_store_does_not_prevent_a_start(tmp_path, garbage):
    (tmp_path / NAME).write_bytes(garbage)
    store = CalibrationStore(tmp_path)
    assert "put aside" in store.troubles[0]
    assert store.is_persistent
    assert next(tmp_path.glob("damaged-*")).read_bytes() == garbage


def test_what_can_be_read_of_a_damaged_store_is_taken_over(tmp_path):
    ids = filled(tmp_path, 200)
    path = tmp_path / NAME
    raw = bytearray(path.read_bytes())
    raw[-4096:] = b"\xa5" * 4096  # the last page: a part of the sets or of an index
    path.write_bytes(raw)
    store = CalibrationStore(tmp_path)
    known = {kept.id for kept in store.sets(BOARD)}
    assert len(known) > 100
    assert known <= set(ids)
    assert f"{len(known)} sets could be read" in store.troubles[0]
    if ids[-1] in known:
        assert store.in_force(BOARD)[Sensor.MAG].id == ids[-1]


def test_an_empty_file_is_reported(tmp_path):
    (tmp_path / NAME).touch()
    store = CalibrationStore(tmp_path)
    assert "empty" in store.troubles[0]
    store.add(mag_set())


def test_a_number_changed_inside_a_sound_file_is_noticed(tmp_path):
    ids = filled(tmp_path, 3)
    with sqlite3.connect(tmp_path / NAME) as connection:
        connection.execute("UPDATE sets SET body=replace(body, '0.25', '0.26') WHERE id=?", (ids[1],))
    connection.close()
    store = CalibrationStore(tmp_path)
    assert [kept.id for kept in store.sets(BOARD)] == [ids[2], ids[0]]
    assert ids[1] in store.troubles[0]
    assert code_of(lambda: store.apply(BOARD, ids[1], "operator")) == "no-such-set"


def test_a_store_of_a_newer_navdeck_is_left_alone(tmp_path):
    filled(tmp_path, 1)
    with sqlite3.connect(tmp_path / NAME) as connection:
        connection.execute("PRAGMA user_version=99")
    connection.close()
    before = (tmp_path / NAME).read_bytes()
    store = CalibrationStore(tmp_path)
    assert not store.is_persistent
    assert "newer" in store.troubles[0]
    store.apply(BOARD, store.add(mag_set()).id, "operator")
    assert (tmp_path / NAME).read_bytes() == before


def test_a_folder_that_cannot_be_made_leaves_a_store_in_memory(tmp_path):
    (tmp_path / "file").touch()
    store = CalibrationStore(tmp_path / "file" / "calibration")
    assert not store.is_persistent
    assert "lost when navdeck ends" in store.troubles[0]
    store.apply(BOARD, store.add(mag_set(0.3)).id, "operator")
    assert store.calibration(BOARD).mag_offset[0] == 0.3


def test_a_full_disk_is_a_refusal_and_changes_nothing(store):
    a = store.add(mag_set()).id
    pages = store._connection.execute("PRAGMA page_count").fetchone()[0]
    store._connection.execute(f"PRAGMA max_page_count={pages}")
    big = mag_set(note="x" * 100_000)
    assert code_of(lambda: store.add(big)) == "store-unavailable"
    store._connection.execute("PRAGMA max_page_count=1000000")
    assert [kept.id for kept in store.sets(BOARD)] == [a]
    store.add(big)
