"""The kinds of arrays that signatures speak of, whose docstrings give shape and unit; and products of vectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Rows = TypeVar("Rows", bound="DataclassInstance")
"""A dataclass of arrays, each with a row for each of the same things, or one row that is the same for all."""

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]


def cross(one: Array, two: Array) -> Array:
    """Return the cross products of vectors (..., 2) in the plane, (...)."""
    product: Array = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    return product


def unit_vectors(angle: Array) -> Array:
    """Return the unit vectors (..., 2) in directions (...), rad."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def left_of(vector: Array) -> Array:
    """Return vectors (..., 2), turned to the left by a right angle."""
    return np.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def kronecker(one: Array, two: Array) -> Array:
    """Return the Kronecker products of matrices (..., a, b) and (..., c, d), (..., a c, b d)."""
    product: Array = one[..., :, None, :, None] * two[..., None, :, None, :]
    a, c, b, d = product.shape[-4:]
    return product.reshape(*product.shape[:-4], a * c, b * d)


def grown(values: NDArray[Any], size: int, axis: int = -1) -> NDArray[Any]:
    """Return an array that is longer along an axis, with zeros at its end."""
    more = np.zeros((values.ndim, 2), dtype=np.intp)
    more[axis, 1] = size - values.shape[axis]
    return np.pad(values, more)


def run_of(places: Index) -> Index | slice:
    """Return places as a slice if they are one after the other: so nothing is copied."""
    if not len(places):
        return slice(0)
    first, end = int(places[0]), int(places[-1]) + 1
    is_run = end - first == len(places) and bool((places == np.arange(first, end)).all())
    return slice(first, end) if is_run else places


def rows_of(part: Rows, some: Index | Mask | slice) -> Rows:
    """Return some of the rows, contiguous: so each has the same bits beside others as alone."""

    def taken(values: Any) -> Any:
        if is_dataclass(values):
            return rows_of(values, some)  # type: ignore[type-var]
        return np.ascontiguousarray(values[some]) if _is_by_row(values, count) else values

    count = _count(part)
    return replace(part, **{name: taken(getattr(part, name)) for name in _names(type(part))})


def joined(parts: Sequence[Rows]) -> Rows:
    """Return the rows of all parts, one part after the other."""

    def together(several: list[Any]) -> Any:
        if is_dataclass(several[0]):
            return joined(several)
        for values, count in zip(several, counts, strict=True):
            if not _is_by_row(values, count):
                return values
        return np.concatenate(several)

    counts = [_count(part) for part in parts]
    names = _names(type(parts[0]))
    return replace(parts[0], **{name: together([getattr(part, name) for part in parts]) for name in names})


@lru_cache
def _names(kind: type[DataclassInstance]) -> tuple[str, ...]:
    return tuple(one.name for one in fields(kind))


def _count(part: DataclassInstance) -> int:
    """Number of rows: of the first array."""
    values = (getattr(part, name) for name in _names(type(part)))
    return next((len(one) for one in values if isinstance(one, np.ndarray)), 0)


def _is_by_row(values: Any, count: int) -> bool:
    return isinstance(values, np.ndarray) and len(values) == count
