"""Several threads and several processes on one store."""

import itertools
import sqlite3
import subprocess
import sys
import threading

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


def test_threads_do_not_disturb_each_other(store):
    errors = []

    def work(number):
        try:
            for k in range(15):
                kept = store.add(mag_set(100 * number + k))
                store.apply(BOARD, kept.id, str(number))
                assert store.calibration(BOARD).mag_offset[1] == 0.25
        except Exception as error:
            errors.append(error)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert len(store.sets(BOARD)) == 60
    log = list(reversed(store.history(BOARD, Sensor.MAG)))
    assert len(log) == 60
    assert all(after.old == before.new for before, after in itertools.pairwise(log))


ADD = """
import sys
from pathlib import Path
from server.calibration.store import CalibrationStore
from tests.calibration.store_sets import BOARD, mag_set
store = CalibrationStore(Path(sys.argv[1]))
for k in range(25):
    store.apply(BOARD, store.add(mag_set(k)).id, sys.argv[2])
print(store.troubles)
"""


def test_two_processes_share_a_folder_from_its_first_moment(tmp_path, repository):
    runs = [
        subprocess.Popen([sys.executable, "-c", ADD, str(tmp_path), name], cwd=repository, stdout=subprocess.PIPE)
        for name in ("first", "second")
    ]
    assert [run.communicate(timeout=120)[0].strip() for run in runs] == [b"[]", b"[]"]
    store = CalibrationStore(tmp_path)
    assert len(store.sets(BOARD)) == 50
    log = list(reversed(store.history(BOARD, Sensor.MAG)))
    assert len(log) == 50
    assert all(after.old == before.new for before, after in itertools.pairwise(log))


def test_a_store_held_by_another_process_is_a_clear_refusal(store, monkeypatch):
    other = sqlite3.connect(store.folder / NAME, isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    store._connection.execute("PRAGMA busy_timeout=50")
    assert code_of(lambda: store.add(mag_set())) == "store-busy"
    assert code_of(lambda: store.sets(BOARD)) == "store-busy"
    monkeypatch.setattr("server.calibration.store_file.BUSY_TIMEOUT_S", 0.05)
    assert code_of(lambda: CalibrationStore(store.folder)) == "store-busy"  # and nothing was put aside
    other.execute("ROLLBACK")
    other.close()
    store.add(mag_set())
    assert list(store.folder.glob("damaged-*")) == []
