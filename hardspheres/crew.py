"""The threads that run one gas together: each has tables of its own beside those of all."""

import threading
from collections.abc import Callable
from typing import Any

from hardspheres.kernel.arrays import OF_RUN, OF_SEARCH, allocated
from hardspheres.sums import add_sums

__all__ = ["Crew"]

OWN = tuple(array for array in OF_RUN + OF_SEARCH if array.own)


class Crew:
    """Calls a kernel from several threads at once.

    Parameters
    ----------
    kernels : module
        `kernel.threads.loop` of a kind of scene.
    arrays : Arrays
        The engine's arrays; the first thread has them as they are.
    blocks : callable
        `Engine.blocks`.

    Attributes
    ----------
    log : list of arrays
        What the threads have logged since somebody emptied this, thread by thread, in the kernels' rows.
    """

    def __init__(self, kernels: Any, arrays: Any, blocks: Callable[[Any], list[Any]]) -> None:
        self.at: Any = kernels.at
        self.blocks = blocks
        self.kernels, self.arrays = kernels, arrays
        at, count = self.at, arrays.counter
        self.records = [arrays]
        for _ in range(1, int(count[at.THREAD_COUNT])):
            self.records.append(arrays._replace(**allocated(OWN, at, count)))
        self.tables = [kernels.handed_over(record) for record in self.records]
        self.log: list[Any] = []

    def run(self, *arguments: Any) -> int:
        """Call the kernel from all threads; what each has counted is then added to the engine's arrays.

        None of them is the caller's, so that an interrupt comes before or after, and not in between.
        """
        self.kernels.run(self.tables[0], False, 0, 0.0, 0, 0)  # compiled before anybody waits for others
        status: list[int] = []
        leader = threading.Thread(target=lambda: status.append(self._run(arguments)), daemon=True)
        leader.start()
        interrupt: BaseException | None = None
        while leader.is_alive():
            try:
                leader.join()
            except BaseException as error:  # noqa: BLE001  what a signal raises
                interrupt = error
        if interrupt:
            raise interrupt
        return status[0]

    def _run(self, arguments: tuple[Any, ...]) -> int:
        first, *others = self.records
        for thread, record in enumerate(others, 1):
            record.number[:], record.counter[:] = first.number, first.counter
            record.counter[self.at.THREAD] = thread
            record.counter[list(self.at.COUNTED)] = 0
            record.counter[self.at.COUNTERS :] = 0
            record.total[:] = 0
        waiting = [
            threading.Thread(target=self.kernels.run, args=(table, *arguments), daemon=True)
            for table in self.tables[1:]
        ]
        for other in waiting:
            other.start()
        status = int(self.kernels.run(self.tables[0], *arguments))
        for other in waiting:
            other.join()
        self._collect()
        for record in others:
            self._add(first, record)
        return status

    def _add(self, first: Any, record: Any) -> None:
        at = self.at
        for k in at.COUNTED:
            first.counter[k] += record.counter[k]
        first.counter[at.COUNTERS :] += record.counter[at.COUNTERS :]
        for k in (at.SHORT_LISTS, at.SHORT_CELLS, at.SHORT_QUEUE, at.LAST_PAIR_EPOCH):
            first.counter[k] = max(first.counter[k], record.counter[k])
        for k in (at.NOW, at.LAST_ADVANCE):
            first.number[k] = max(first.number[k], record.number[k])
        for sums, more in zip(self.blocks(first.total), self.blocks(record.total), strict=True):
            add_sums(sums, more)

    def _collect(self) -> None:
        """Empty the logs of all threads."""
        at = self.at
        for record in self.records:
            logged = int(record.counter[at.LOGGED])
            if logged:
                self.log.append(record.log[: logged * at.LOG_ROW].reshape(logged, at.LOG_ROW).copy())
                record.counter[at.LOGGED] = 0
