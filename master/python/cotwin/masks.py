"""Masked arrays, whose masked elements are not meant as values."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._native import BadValue


def refuse_mask(place: str, value: Any) -> None:
    """Raises BadValue for an array of numpy.ma with masked elements."""
    if isinstance(value, np.ma.MaskedArray) and np.any(np.ma.getmask(value)):
        raise BadValue(f"{place}: has masked elements, expected an array without a mask; filled(value) makes one")
