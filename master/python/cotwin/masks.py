"""Masked arrays, whose masked elements are not meant as values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._native import BadValue


def refuse_mask(place: str, value: Any, depth: int = 0) -> None:
    """Raises BadValue for an array of numpy.ma with masked elements, also within lists and other sequences, where NumPy drops masks."""
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)) and depth < 32:  # dimensions that NumPy has at most
        for element in value:
            if not isinstance(element, float):
                refuse_mask(place, element, depth + 1)
    elif isinstance(value, np.ma.MaskedArray) and np.any(np.ma.getmask(value)):
        raise BadValue(f"{place}: has masked elements, expected an array without a mask; filled(value) makes one")
