"""`python -m pipeline`."""

import ctypes
import os
import signal
import sys

# strips are worked out side by side; threads of the matrix library's own beside them only wait for one another. It reads this once
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from pipeline.cli import main  # noqa: E402

#: glibc's names for what `_keep_freed_memory` sets (malloc.h), and how much is kept [byte].
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
KEPT, LARGEST = 2**31 - 1, 2**30


def _keep_freed_memory() -> None:
    """Arrays as large as a photograph are made and freed all the time: given back to the system in between, its pages are cleared
    anew each time (24 megapixels, geometry: 6.6 s of the system's, 4 s so). Where there is no glibc nothing is set."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return
    mallopt(M_MMAP_THRESHOLD, LARGEST)
    mallopt(M_TRIM_THRESHOLD, KEPT)


def _ended(number, frame):
    # as an exception it passes every `finally`, so that nothing half-written and no POV-Ray is left behind
    raise SystemExit(128 + number)


for ending in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(ending, _ended)
_keep_freed_memory()
sys.exit(main())
