"""The store: sets, what is in force, the way back, bounds."""

import os

import numpy as np
import pytest

from server.calibration.records import CalibrationSet
from server.calibration.records_json import to_json
from server.calibration.store import CalibrationStore
from server.calibration.store_history import Applied, roll_back_target
from server.calibration.store_ids import new_id
from server.nav.calibration.types import Sensor
from tests.calibration.store_sets import BOARD, code_of, full_set, mag_set


@pytest.fixture
def store(tmp_path):
    made = CalibrationStore(tmp_path / "calibration")
    yield made
    made.close()


def gyro_set(bias=0.01):
    parameters = {"bias": np.full(3, bias), "scale": np.full(3, 1.01)}
    return CalibrationSet(board_id=BOARD, sensor=Sensor.GYRO, kind="import", parameters=parameters)


def test_a_set_outlives_the_process_exactly(tmp_path):
    kept = CalibrationStore(tmp_path).add(full_set())
    again = CalibrationStore(tmp_path)
    assert to_json(again.get(BOARD, kept.id)) == to_json(full_set())
    assert (again.troubles, again.is_persistent) == ([], True)


def test_sets_come_newest_first_and_by_sensor(store):
    ids = [store.add(mag_set(number)).id for number in range(4)]
    gyro = store.add(gyro_set()).id
    store.add(mag_set(board_id="another"))
    assert [kept.id for kept in store.sets(BOARD)] == [gyro, *reversed(ids)]
    assert [kept.id for kept in store.sets(BOARD, Sensor.MAG)] == list(reversed(ids))
    assert ids == sorted(ids)


def test_ids_ascend_and_never_repeat():
    ids = [new_id() for _ in range(5000)]
    assert ids == sorted(ids)
    assert len({one[:9] for one in ids}) == len(ids)


def test_an_applied_set_is_what_preprocessing_gets(store):
    kept, gyro = store.add(mag_set(0.3)), store.add(gyro_set())
    assert store.calibration(BOARD).is_identity
    store.apply(BOARD, kept.id, "operator")
    store.apply(BOARD, gyro.id, "operator")
    whole = store.calibration(BOARD)
    assert whole.mag_offset.tolist() == [0.3, 0.25, -0.1]
    assert whole.gyro_matrix.tolist() == np.diag([1.01] * 3).tolist()
    assert set(store.in_force(BOARD)) == {Sensor.MAG, Sensor.GYRO}
    assert store.calibration("another").is_identity


def test_rolling_back_walks_the_history_and_a_new_application_starts_from_there(store):
    a, b, c = (store.add(mag_set(number)).id for number in range(3))
    for set_id in (a, b, c):
        store.apply(BOARD, set_id, "operator")
    assert store.roll_back(BOARD, Sensor.MAG, "operator").id == b
    assert store.roll_back(BOARD, Sensor.MAG, "operator").id == a
    store.apply(BOARD, c, "operator")
    assert store.roll_back(BOARD, Sensor.MAG, "operator").id == a
    assert store.roll_back(BOARD, Sensor.MAG, "operator") is None
    assert store.in_force(BOARD) == {}
    assert not store.can_roll_back(BOARD, Sensor.MAG)
    assert code_of(lambda: store.roll_back(BOARD, Sensor.MAG, "operator")) == "nothing-before"


def test_a_calibration_taken_off_comes_back_by_rolling_back(store):
    a = store.add(mag_set()).id
    store.apply(BOARD, a, "operator")
    store.take_off(BOARD, Sensor.MAG, "operator")
    assert store.in_force(BOARD) == {}
    assert store.roll_back(BOARD, Sensor.MAG, "operator").id == a
    assert code_of(lambda: store.take_off(BOARD, Sensor.GYRO, "operator")) == "nothing-in-force"


def test_a_roll_back_passes_over_sets_that_were_deleted(store):
    a, b, c = (store.add(mag_set(number)).id for number in range(3))
    for set_id in (a, b, c):
        store.apply(BOARD, set_id, "operator")
    store.delete(BOARD, b)
    assert store.roll_back(BOARD, Sensor.MAG, "operator").id == a


def test_the_history_says_who_changed_what_and_when(store):
    a, b = (store.add(mag_set(number)).id for number in range(2))
    store.apply(BOARD, a, "first")
    store.apply(BOARD, b, "second")
    store.apply(BOARD, b, "third")  # in force already: nothing happened
    store.roll_back(BOARD, Sensor.MAG, "fourth")
    told = [(one.action, one.old, one.new, one.by) for one in store.history(BOARD, Sensor.MAG)]
    assert told == [("roll_back", b, a, "fourth"), ("apply", a, b, "second"), ("apply", "", a, "first")]
    assert store.history(BOARD, Sensor.MAG)[0].utc >= store.history(BOARD, Sensor.MAG)[-1].utc
    assert store.history(BOARD, Sensor.GYRO) == []


def test_the_target_survives_a_history_whose_beginning_was_forgotten():
    log = [
        Applied(action="apply", old="a", new="b", by="", utc=""),
        Applied(action="roll_back", old="b", new="z", by="", utc=""),
    ]
    assert roll_back_target(log, frozenset("abz")) is None
    assert roll_back_target(log[:1], frozenset("ab")) == "a"


def test_what_is_in_force_cannot_be_deleted_until_it_is_replaced(store):
    a, b = (store.add(mag_set(number)).id for number in range(2))
    store.apply(BOARD, a, "operator")
    assert code_of(lambda: store.delete(BOARD, a)) == "set-in-force"
    store.apply(BOARD, b, "operator")
    store.delete(BOARD, a)
    assert code_of(lambda: store.get(BOARD, a)) == "no-such-set"
    assert code_of(lambda: store.delete(BOARD, a)) == "no-such-set"
    assert code_of(lambda: store.apply("another", b, "operator")) == "no-such-set"


def test_an_id_is_given_once(store):
    store.add(mag_set(id="one"))
    assert code_of(lambda: store.add(mag_set(id="one"))) == "set-exists"


def test_two_sets_are_compared_by_id(store):
    a, b = store.add(mag_set(0.1)).id, store.add(mag_set(0.2)).id
    assert max(row.change for row in store.diff(BOARD, a, b)) == pytest.approx(0.1)
    assert max(row.new for row in store.diff(BOARD, "", b)) == 1.1
    gyro = store.add(gyro_set()).id
    assert code_of(lambda: store.diff(BOARD, a, gyro)) == "sensor-mismatch"


def test_past_the_bound_the_oldest_set_not_in_force_goes_with_its_samples(tmp_path):
    store = CalibrationStore(tmp_path, max_sets=3)
    folders = [store.samples_folder(BOARD, f"job-{k}") for k in range(5)]
    for folder in folders:
        folder.mkdir(parents=True)
    kept = [store.add(mag_set(k, samples_file=str(folders[k]))) for k in range(2)]
    store.apply(BOARD, kept[0].id, "operator")
    kept += [store.add(mag_set(k, samples_file=str(folders[k]))) for k in range(2, 5)]
    assert [one.id for one in store.sets(BOARD)] == [kept[4].id, kept[3].id, kept[0].id]
    assert [folder.exists() for folder in folders] == [True, False, False, True, True]
    assert store.samples_of(kept[0]) == folders[0]


def test_samples_named_by_two_sets_stay_until_both_are_gone(store):
    folder = store.samples_folder("serial:///dev/ttyACM0", "job")
    folder.mkdir(parents=True)
    assert folder.is_relative_to(store.folder.absolute() / "samples")
    a, b = (store.add(mag_set(samples_file=str(folder))) for _ in range(2))
    assert not os.path.isabs(a.samples_file)
    store.delete(BOARD, a.id)
    assert folder.exists()
    store.delete(BOARD, b.id)
    assert not folder.exists()


@pytest.mark.parametrize("name", ["..", "../..", "/etc", ".", "x/../../.."])
def test_a_set_cannot_name_a_folder_outside_of_the_samples(store, name):
    (store.folder / "samples").mkdir()
    kept = store.add(mag_set(samples_file=name))
    assert store.samples_of(kept) is None
    store.delete(BOARD, kept.id)
    assert store.folder.exists()


def test_trimming_removes_the_oldest_samples_that_no_set_names(store):
    folders = [store.samples_folder(BOARD, f"job-{k}") for k in range(3)]
    for k, folder in enumerate(folders):
        folder.mkdir(parents=True)
        (folder / "imu.csv").write_bytes(b"x" * 1000)
        os.utime(folder, (k, k))
    store.add(mag_set(samples_file=str(folders[0])))
    assert store.trim_samples(2000) == 1
    assert [folder.exists() for folder in folders] == [True, False, True]


def test_board_ids_that_make_the_same_folder_name_do_not_share_it(store):
    assert store.samples_folder("a/b", "j") != store.samples_folder("a-b", "j")
    assert store.samples_folder("..", "..").is_relative_to(store.folder.absolute() / "samples")
