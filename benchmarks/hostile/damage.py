"""What is done to good input: values replaced by absurd ones, keys lost, bytes cut, doubled and turned."""

from __future__ import annotations

import json
from copy import deepcopy
from typing import Any

import numpy as np

Rng = np.random.Generator

ODD: tuple[Any, ...] = (
    None,
    True,
    False,
    "",
    "x",
    "nan",
    "1e3",
    "\u2028",
    0,
    -1,
    1,
    3,
    10**20,
    10**400,
    -0.0,
    0.1,
    1e-300,
    -1e-9,
    1e9,
    -1e12,
    1e300,
    float("nan"),
    float("inf"),
    float("-inf"),
    [],
    {},
    [[]],
    [None],
    [1.0, 2.0],
    [[0.0, 0.0], [0.0, 0.0]],
    [0.0] * 300,
    {"x": 1},
)
"""Values that stand where others should."""

ODD_BYTES = (
    b"\x00",
    b"\xff\xfe",
    b"{",
    b"}",
    b"[",
    b"]",
    b":",
    b"-",
    b"&a ",
    b"*a",
    b"<<: ",
    b"!!python/x ",
    b"\t",
    b"9" * 50,
)


LARGEST = 10**300  # of an integer that was put in, and is multiplied once more


def damaged(data: Any, rng: Rng) -> Any:
    """Give a copy of nested data with some damage."""
    made = json.loads(json.dumps(data))
    for _ in range(int(rng.integers(1, 5))):
        if made:
            _damage_once(made, rng)
    return made


def _damage_once(data: Any, rng: Rng) -> None:
    parent, key = _some_place(data, rng)
    value = parent[key]
    match int(rng.integers(0, 8)):
        case 0:
            del parent[key]
        case 1 if isinstance(parent, dict):
            parent[f"{key}s"] = parent.pop(key)
        case 2 if isinstance(value, list) and value:
            value.append(deepcopy(value[int(rng.integers(len(value)))]))
        case 3 if isinstance(value, list) and value:
            del value[int(rng.integers(len(value))) :]
        case 4 | 5 if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST:
            parent[key] = value * float(rng.choice([-1.0, 0.0, 1e-6, 1e-3, 10.0, 1e3, 1e6, 1.0 + 1e-9]))
        case _:
            parent[key] = deepcopy(ODD[int(rng.integers(len(ODD)))])


def _some_place(data: Any, rng: Rng) -> tuple[Any, Any]:
    """Go down from the top by chance; give a mapping or a list, and which of its values."""
    parent, key = data, next(iter(data))
    while True:
        keys = list(parent) if isinstance(parent, dict) else list(range(len(parent)))
        key = keys[int(rng.integers(len(keys)))]
        below = parent[key]
        if not isinstance(below, dict | list) or not below or rng.random() < 0.15:
            return parent, key
        parent = below


def cut(text: bytes, rng: Rng) -> bytes:
    """Give bytes of a file with some damage."""
    for _ in range(int(rng.integers(1, 4))):
        first, last = sorted(rng.integers(0, len(text) + 1, 2).tolist())
        last = min(last, first + int(rng.integers(1, 60)))
        match int(rng.integers(0, 5)):
            case 0:
                text = text[:first]
            case 1:
                text = text[:first] + text[last:]
            case 2:
                text = text[:last] + text[first:]
            case 3:
                text = text[:first] + bytes([int(rng.integers(0, 256))]) + text[first + 1 :]
            case _:
                text = text[:first] + ODD_BYTES[int(rng.integers(len(ODD_BYTES)))] + text[first:]
        text = text or b"\n"
    return text
