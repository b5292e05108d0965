"""kill -9 in the middle of applications: the store opens, with the old or the new set in force, never neither."""

import os
import random
import signal
import subprocess
import sys
import time

from server.calibration.store import CalibrationStore
from server.nav.calibration.types import Sensor
from tests.calibration.store_sets import BOARD, mag_set

KILLS = 200
FLIP = """
import os, sys
from pathlib import Path
from server.calibration.store import CalibrationStore
from tests.calibration.store_sets import BOARD
folder, ids = Path(sys.argv[1]), sys.argv[2:]
while sys.stdin.readline():  # a child of the child is what gets killed: it has everything imported already
    child = os.fork()
    if child == 0:
        store = CalibrationStore(folder)
        os.write(1, b"%d\\n" % os.getpid())
        while True:
            for set_id in ids:
                store.apply(BOARD, set_id, "child")
    os.waitpid(child, 0)
"""


def test_two_hundred_kills_during_apply_leave_one_of_the_two_sets_in_force(tmp_path, repository):
    store = CalibrationStore(tmp_path)
    ids = [store.add(mag_set(number)).id for number in range(2)]
    store.apply(BOARD, ids[0], "test")
    store.close()
    wait_s = random.Random(20261122)
    seen, journals = [], 0
    with subprocess.Popen(
        [sys.executable, "-c", FLIP, str(tmp_path), *ids],
        cwd=repository,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as parent:
        try:
            for _ in range(KILLS):
                parent.stdin.write(b"go\n")
                parent.stdin.flush()
                child = int(parent.stdout.readline())
                time.sleep(wait_s.uniform(0.0, 0.02))
                os.kill(child, signal.SIGKILL)
                journals += (tmp_path / "calibration.sqlite3-journal").exists()
                opened = CalibrationStore(tmp_path)
                assert opened.troubles == []
                seen.append(opened.in_force(BOARD)[Sensor.MAG].id)
                assert opened.history(BOARD, Sensor.MAG)[0].new == seen[-1]
                opened.close()
        finally:
            parent.kill()
    assert set(seen) == set(ids)  # it was killed in the middle of work, not before it
    assert journals > KILLS // 20  # and in the middle of a write
