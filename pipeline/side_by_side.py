"""Strips of an image worked out by several threads, in bounded memory."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Part, Result = TypeVar("Part"), TypeVar("Result")
#: More would hold more strips in memory and gain little.
MOST_THREADS = 4


def side_by_side(work: Callable[[Part], Result], parts: Iterable[Part]) -> Iterator[Result]:
    """What `work` makes of each part, in their order; as many are begun ahead of what is asked for as there are threads."""
    threads = min(MOST_THREADS, os.cpu_count() or 1)
    with ThreadPoolExecutor(threads) as pool:
        begun: deque = deque()
        try:
            for part in parts:
                begun.append(pool.submit(work, part))
                if len(begun) > threads:
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            for one in begun:
                one.cancel()
