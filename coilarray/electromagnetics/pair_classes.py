"""Which of many pairs are the same, where each pair may be written in two ways."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def pair_classes(key: IntArray, turned: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Group pairs by what they are.

    Parameters
    ----------
    key, turned : ndarray of int, shape (n, columns)
        Two rows that mean the same, for each pair.

    Returns
    -------
    example : ndarray of int, shape (classes,)
        One pair of each class.
    number : ndarray of int, shape (n,)
        The class of each pair.
    turn : ndarray of bool, shape (n,)
        Where the row in `turned` stands for the class.

    Examples
    --------
    >>> example, number, turn = pair_classes(np.array([[1, 2], [2, 1], [3, 3]]), np.array([[2, 1], [1, 2], [3, 3]]))
    >>> number, turn
    (array([0, 0, 1]), array([False,  True, False]))
    """
    turn, undecided = np.zeros(len(key), dtype=bool), np.ones(len(key), dtype=bool)
    for column in range(key.shape[1]):
        turn |= undecided & (turned[:, column] < key[:, column])
        undecided &= turned[:, column] == key[:, column]
    number = np.zeros(len(key), dtype=np.int64)
    for column in np.where(turn[:, None], turned, key).T:
        if (column != column[0]).any():
            values, place = np.unique(column, return_inverse=True)
            number = np.unique(number * len(values) + place, return_inverse=True)[1]
    return np.unique(number, return_index=True)[1], number, turn
