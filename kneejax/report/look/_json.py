"""What JSON can hold."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import numpy as np


def json_safe(value: Any) -> Any:
    """Turn arrays, numbers, paths and mappings into what JSON can hold; NaN becomes None.

    Args:
        value: anything.

    Returns:
        Dictionaries, lists, strings, numbers, booleans and None.
    """
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, enum.Enum):
        return value.name.lower()
    if isinstance(value, Mapping):
        return {str(key): json_safe(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_safe(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted((json_safe(item) for item in value), key=str)
    if isinstance(value, PurePath):
        return value.as_posix()
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.generic) or hasattr(value, "__array__"):
        return json_safe(np.asarray(value).tolist())
    return str(value)
