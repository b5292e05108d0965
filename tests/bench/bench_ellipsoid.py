"""The ellipsoid's accumulator, against NumPy building D in chunks and DᵀD, and against a bare loop over the moments.

NumPy's way is what S0 (3.9) comes to with bounded memory: D of 1000 samples at a time, 10 columns, DᵀD added up; it
rejects nothing, knows no coverage and loses digits with a far offset. The bare loop adds the 35 moments and does no
more. Ours is timed from the empty stream on, growing of the cubes included. Target: ≤ 100 ns a sample, memory constant
over 10⁶ samples.
"""

import tracemalloc
from time import perf_counter

import numpy as np
from numba import njit

from server.nav.calibration.ellipsoid_kernel import add_moments
from server.nav.calibration.ellipsoid_moments import MomentStream

SAMPLES, BLOCK, ROUNDS = 1_000_000, 1000, 5


@njit
def bare_loop(xyz, out):
    """Add the moments of all samples."""
    for i in range(len(xyz)):
        add_moments(xyz[i, 0], xyz[i, 1], xyz[i, 2], out)


def by_numpy(xyz):
    """Return DᵀD, shape (10, 10)."""
    total = np.zeros((10, 10))
    for at in range(0, len(xyz), BLOCK):
        x, y, z = xyz[at : at + BLOCK].T
        d = np.column_stack([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z, np.ones(len(x))])
        total += d.T @ d
    return total


def by_stream(xyz):
    stream = MomentStream()
    for at in range(0, len(xyz), BLOCK):
        stream.feed(xyz[at : at + BLOCK])
    return stream


def best_ns(work, xyz):
    times = []
    for _ in range(ROUNDS):
        start = perf_counter()
        work(xyz)
        times.append(perf_counter() - start)
    return min(times) / len(xyz) * 1e9


def sweep(rng):
    """A hand turning the board at 50 Hz: successive samples are near each other."""
    a, b = (np.cumsum(rng.normal(size=SAMPLES) * 0.004 + rate) for rate in (0.02, 0.0074))
    flat = np.stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)], axis=1)
    return np.ascontiguousarray(flat * 0.5 + np.array([0.2, -0.3, 0.1]) + rng.normal(size=flat.shape) * 0.003)


def main():
    rng = np.random.default_rng(0)
    given = sweep(rng)
    for name, xyz in (("hand sweep", given), ("random order", rng.permutation(given))):
        ours, peer = best_ns(by_stream, xyz), best_ns(by_numpy, xyz)
        bare = best_ns(lambda x: bare_loop(x, np.zeros(36)), xyz)
        print(f"{name}: {ours:.0f} ns a sample; NumPy D in chunks {peer:.0f} ns ({peer / ours:.1f} ×); ", end="")
        print(f"bare moments {bare:.0f} ns ({ours / bare:.1f} × that)")
    stream = by_stream(given[:BLOCK])
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for at in range(0, SAMPLES, BLOCK):
        stream.feed(given[at : at + BLOCK])
    print(f"memory kept after {SAMPLES} samples: {tracemalloc.get_traced_memory()[0] - before} bytes more than before")


if __name__ == "__main__":
    main()
