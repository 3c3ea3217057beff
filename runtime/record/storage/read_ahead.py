"""Work on the chunks of a file in a few threads, ahead of the reader."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

THREADS_LIMIT = 4
BYTES_LIMIT = 8 << 20  # of results that wait for the reader

Item = TypeVar("Item")
Result = TypeVar("Result")


def ahead(work: Callable[[Item], Result], items: Iterable[Item], size: Callable[[Item], int]) -> Iterator[Result]:
    """Yield the result of each item, in order, while threads work on the next items.

    work : function of an item; it runs in a thread, and another one of them runs when it releases the GIL
    size : function of an item that returns the size of its result in bytes. At most BYTES_LIMIT wait, or one result

    Raises the first exception of `work` or `items` when its turn comes, or before.
    """
    threads = min(THREADS_LIMIT, len(os.sched_getaffinity(0)))
    if threads < 2:
        yield from map(work, items)
        return
    from concurrent.futures import Future, ThreadPoolExecutor

    waiting: deque[tuple[Future[Result], int]] = deque()  # with the bytes of each
    held = 0
    with ThreadPoolExecutor(threads) as pool:
        try:
            for item in items:
                need = size(item)
                while waiting and held + need > BYTES_LIMIT:
                    future, done = waiting.popleft()
                    held -= done
                    yield future.result()
                waiting.append((pool.submit(work, item), need))
                held += need
            while waiting:
                yield waiting.popleft()[0].result()
        finally:
            for future, _ in waiting:
                future.cancel()
