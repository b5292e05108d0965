"""What learning the magnetometer's offset costs a navigation step, beside the attitude mode of the main lane.

Both get the same steps and samples in one call: a hand that turns, one that changes direction five times faster, a
disturbance that keeps both explanations running, and rest. Target: well under 1 µs a step, under a fifth of the peer.

Run by hand: python tests/bench/bench_mag_learning.py. Trust the ratios; the best of a few runs counts.
"""

from time import perf_counter

import numpy as np

from server.nav.calibration.mag_learning import MagLearner
from server.nav.ekf.attitude import layout as attitude
from server.nav.ekf.attitude.block import run_block
from server.nav.ekf.attitude.parameters import default_parameters
from server.nav.ekf.layout import U_ACCEL_MEAN, U_DT, U_DTHETA, U_DVEL, U_GYRO_MEAN
from tests.calibration.mag_learning_simulation import World, simulate

ROUNDS = 7


def sweep(t_s):
    """A field of the room that no constant offset explains."""
    return 0.3 * np.stack([np.sin(0.5 * t_s), np.cos(0.7 * t_s), np.sin(1.1 * t_s)], axis=1)


WORLDS = {
    "turning": World(duration_s=120.0),
    "turning fast": World(duration_s=120.0, rate_rad_s=5.0),
    "disturbed": World(duration_s=120.0, room=sweep),
    "at rest": World(duration_s=120.0, rest_s=120.0),
}


def best(run):
    """Return the shortest of some runs, s."""
    times = []
    for _ in range(ROUNDS):
        begin = perf_counter()
        run()
        times.append(perf_counter() - begin)
    return min(times)


def peer(steps, meas):
    """Run the attitude mode over the same."""
    rows = np.empty((len(steps), attitude.O_SIZE))
    run_block(steps, meas, 0.0, attitude.new_memory(), default_parameters(), rows)


def fill(steps):
    """Write what the peer needs beside rotation; any specific force costs it the same."""
    steps[:, U_DVEL + 2], steps[:, U_ACCEL_MEAN + 2] = -9.8 * steps[:, U_DT], -9.8
    steps[:, U_GYRO_MEAN : U_GYRO_MEAN + 3] = steps[:, U_DTHETA : U_DTHETA + 3] / steps[:, U_DT, None]


def main():
    """Print a row for each world."""
    for name, world in WORLDS.items():
        steps, meas = simulate(world)
        fill(steps)
        ours = best(lambda s=steps, m=meas: MagLearner().step(s, m)) / len(steps)
        theirs = best(lambda s=steps, m=meas: peer(s, m)) / len(steps)
        print(f"{name:14s} {ours * 1e9:6.0f} ns a step, {ours / theirs:.3f} of the attitude mode")


if __name__ == "__main__":
    main()
