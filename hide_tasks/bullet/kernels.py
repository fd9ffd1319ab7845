"""Kernels: functions that numba compiles to machine code, and the arrays that they are given."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def compiled(function: Kernel) -> Kernel:
    """The function as machine code, cached on disk; strict floating point, so repeatable."""
    return cast(Kernel, numba.njit(cache=True)(function))


def as_array(values: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """A fresh float64 array of the given shape.

    Raises:
        ValueError: the values have another shape; the message names both.
    """
    array = np.array(values, dtype=np.float64, order="C")
    if array.shape != shape:
        raise ValueError(f"{what} has shape {array.shape}, expected {shape}")
    return array
