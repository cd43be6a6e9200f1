"""Templates of strangers: what they compute is bounded in size and time, and reaches no file of the person's."""

from __future__ import annotations

import ctypes
import operator
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from jinja2.sandbox import SandboxedEnvironment

from pipeline.errors import InputError

#: Longest that a template may take [s], and the text it may give [byte]: fixed, for no scene that was drawn needs more.
MAX_SECONDS = 60.0
MAX_BYTES = 512 * 2**20
#: Longest text or list, and largest exponent, that a template's own arithmetic may make.
MAX_LENGTH, MAX_EXPONENT = 10**6, 1000
FIXED = "this limit is fixed, as templates may come from strangers"


class BoundedEnvironment(SandboxedEnvironment):
    """Jinja's sandbox, in which no single operation takes all memory or cannot be interrupted."""

    intercepted_binops = frozenset({"*", "**", "%"})

    def call_binop(self, context, operator_name: str, left, right):
        if operator_name == "**":
            if abs(right) > MAX_EXPONENT or isinstance(left, int) and abs(left) > MAX_LENGTH:
                raise OverflowError(f"power beyond {MAX_EXPONENT}; {FIXED}")
            return operator.pow(left, right)
        if operator_name == "%":
            if isinstance(left, (str, bytes)):
                raise OverflowError("text formatted by %; join it with ~ instead")
            return operator.mod(left, right)
        for text, count in ((left, right), (right, left)):
            if hasattr(text, "__len__") and isinstance(count, int) and len(text) * count > MAX_LENGTH:
                raise OverflowError(f"more than {MAX_LENGTH} characters or entries at once; {FIXED}")
        return operator.mul(left, right)


def joined(pieces: Iterator[str], name: str) -> str:
    """A template's text, as far as it stays below the limit."""
    found, size = [], 0
    for piece in pieces:
        size += len(piece)
        if size > MAX_BYTES:
            raise InputError(f"template gives more than {MAX_BYTES} bytes", place=name, remedy=f"loop less; {FIXED}")
        found.append(piece)
    return "".join(found)


@contextmanager
def in_time(name: str) -> Iterator[None]:
    """Stops a template that loops on: in the main thread by a signal, elsewhere by an exception between two of its steps."""
    in_main = threading.current_thread() is threading.main_thread()
    if in_main and signal.getitimer(signal.ITIMER_REAL)[0]:
        yield
        return
    late: list[bool] = []
    with _by_signal(late) if in_main else _by_exception(late):
        try:
            yield
        except Exception:
            if not late:
                raise
            # whatever Jinja makes of an error between two lines of a template
            raise InputError(f"template takes longer than {MAX_SECONDS:g} s", place=name, remedy=f"loop less; {FIXED}") from None


@contextmanager
def _by_signal(late: list[bool]) -> Iterator[None]:
    def stop(number, frame):
        late.append(True)
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, MAX_SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _by_exception(late: list[bool]) -> Iterator[None]:
    raised = ctypes.pythonapi.PyThreadState_SetAsyncExc
    thread, ended, lock = ctypes.c_ulong(threading.get_ident()), [], threading.Lock()

    def stop():
        with lock:
            if not ended:
                late.append(True)
                raised(thread, ctypes.py_object(TimeoutError))

    timer = threading.Timer(MAX_SECONDS, stop)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        with lock:
            ended.append(True)
        timer.cancel()
        if late:
            # one that has not arrived yet is of no use any more
            raised(thread, None)
