"""How many threads BLAS may use in a fit."""

from contextlib import AbstractContextManager, nullcontext
from functools import cache

from threadpoolctl import ThreadpoolController

WIDE = 16  # channels from which the matrices are large enough for threads to pay


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()


def blas_threads(channels: int) -> AbstractContextManager:
    """Return a context in which BLAS keeps to one thread when the data have few channels.

    The matrices then have some hundreds of rows, and the threads of the two BLAS libraries of numpy and scipy wait for
    each other by spinning: on two shared cores a fit of six channels took 40 to 130 ms so, and 25 ms with one thread.
    """
    return nullcontext() if channels >= WIDE else _libraries().limit(limits=1, user_api="blas")
