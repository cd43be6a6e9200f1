"""`python -m pipeline`."""

import signal
import sys

from pipeline.cli import main


def _ended(number, frame):
    # as an exception it passes every `finally`, so that nothing half-written and no POV-Ray is left behind
    raise SystemExit(128 + number)


for ending in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(ending, _ended)
sys.exit(main())
