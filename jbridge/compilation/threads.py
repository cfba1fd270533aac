"""How many threads NumPy's linear algebra takes."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
R = TypeVar("R")


def one_thread_each(function: Callable[P, R]) -> Callable[P, R]:
    """For a function that runs several computations side by side: each takes its products of matrices alone.

    Such products are many and small here. Threads of their own wait for each other longer than they compute, and that
    waiting keeps processors busy.
    """

    @functools.wraps(function)
    def limited(*args: P.args, **options: P.kwargs) -> R:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **options)

    return limited
