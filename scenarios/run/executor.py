"""Executors: where pieces are made. Processes of this machine now; others implement the same interface."""

import multiprocessing
import os
import signal
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any, Protocol

from excite.errors import ExciteError

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class Piece(Protocol):
    """Something to be made: self-contained, picklable."""

    def make(self, folder: str) -> None:
        """Make the piece and keep it in the store of this folder."""


Each = Callable[[Sequence[Piece]], Iterator[None]]


class Executor(ABC):
    """Makes pieces in any order."""

    @abstractmethod
    def each(self, folder: str, most: int) -> AbstractContextManager[Each]:
        """Return a context whose value maps over pieces, yielding once per piece that is finished.

        most : number of pieces that may be made at once.
        """


@dataclass(frozen=True)
class Local(Executor):
    """Processes of this machine, `jobs` at most; one job runs in this process."""

    jobs: int = 1

    def each(self, folder: str, most: int) -> AbstractContextManager[Each]:
        """Make pieces here, or in processes with one BLAS thread each, which end when this one does."""
        jobs = min(self.jobs, most)
        if jobs <= 1:
            return nullcontext(lambda pieces: (piece.make(folder) for piece in pieces))
        return _processes(folder, jobs)


@contextmanager
def _processes(folder: str, jobs: int) -> Iterator[Each]:
    others = multiprocessing.active_children()
    context = multiprocessing.get_context("spawn")
    with _single_threaded(), ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin) as pool:

        def each(pieces: Sequence[Piece]) -> Iterator[None]:
            with _interrupts_ignored():  # by the processes that the first submit starts; Ctrl-C is for this one
                futures = [pool.submit(_make, piece, folder) for piece in pieces]
            return (future.result() for future in as_completed(futures))

        try:
            yield each
        except BaseException as error:
            for child in multiprocessing.active_children():
                if child not in others:
                    child.terminate()
            if isinstance(error, BrokenProcessPool):
                raise ExciteError(
                    "a worker process died, perhaps for lack of memory; give the same command with fewer --jobs: it goes "
                    "on from the finished pieces"
                ) from error
            raise


def _make(piece: Any, folder: str) -> None:
    piece.make(folder)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Have processes started inside use one BLAS thread each: several times two threads only get in each other's way."""
    before = {name: os.environ.get(name) for name in BLAS_THREADS}
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C inside, as processes started there go on to do; only the main thread can."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _begin() -> None:
    """Leave this process as soon as its parent is gone, however that died; stdout is for the parent's results."""
    sys.stdout = sys.stderr

    def watch() -> None:
        if parent := multiprocessing.parent_process():
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
