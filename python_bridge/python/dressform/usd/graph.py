"""Connected components over dense indices, in numpy alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]


def components(count: int, pairs: Ints) -> Ints:
    """Smallest index of each index's set, shape [count]; ``pairs`` [k, 2] joins sets.

    The smaller label spreads along the pairs and labels are followed to labels in between, which
    halves the way to go at each turn.
    """
    label = np.arange(count)
    while True:
        before = label.copy()
        a, b = label[pairs[:, 0]], label[pairs[:, 1]]
        lowest = np.minimum(a, b)
        for side in (a, b):  # roots first, so that whole sets follow
            np.minimum.at(label, side, lowest)
        label = label[label]
        if np.array_equal(label, before):
            return label


def numbered(label: Ints) -> Ints:
    """Labels as 0, 1, ... in order of first use."""
    _, first, index = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    return rank[index.ravel()]
