"""Small arrays whose elements are numbers or expressions of C."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .header import constant

Atoms = NDArray[Any]
"""An array whose elements are numbers or expressions of C (`str`)."""


def literal(atom: Any) -> str:
    """A number or an expression, as C writes it."""
    return atom if isinstance(atom, str) else constant(atom)


def numbers_in(atoms: Atoms) -> NDArray[Any] | None:
    """The numbers of an array that holds nothing else, otherwise None."""
    if atoms.dtype != object:
        return atoms
    if any(isinstance(each, str) for each in atoms.flat):
        return None
    return np.array(atoms.tolist()).reshape(atoms.shape)


def taken(pool: list[Any], places: NDArray[np.int64]) -> Atoms:
    """An array whose elements are those of a pool at some places."""
    result = np.empty(places.shape, object)
    for at in np.ndindex(places.shape):
        result[at] = pool[int(places[at])]
    return result


def elements(name: str, row: str, shape: tuple[int, ...]) -> Atoms:
    """The elements of one row of an array of C.

    Args:
        name: of the array, in which rows lie one after the other.
        row: its number, or the variable that holds it.
        shape: of a row.
    """
    size = math.prod(shape)
    result = np.empty(shape, object)
    for number, place in enumerate(np.ndindex(shape)):
        result[place] = f"{name}[{number if row == '0' else row if size == 1 else f'{size} * {row} + {number}'}]"
    return result


def c_type(dtype: Any) -> str:
    """The type in C of numbers of a type in NumPy."""
    return "P_real" if np.issubdtype(dtype, np.floating) else "int"
