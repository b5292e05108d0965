"""navdeck: live navigation from a flight board."""

import os
import sys

# Numba reads this once, when it is first imported; server/kernel_cache.py says what its own rule lacks.
os.environ.setdefault(
    "NUMBA_CACHE_LOCATOR_CLASSES",
    "server.kernel_cache.KernelCacheLocator,UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,"
    "IPythonCacheLocator,ZipCacheLocator",
)
if "numba" in sys.modules:
    sys.modules["numba"].config.CACHE_LOCATOR_CLASSES = os.environ["NUMBA_CACHE_LOCATOR_CLASSES"]
