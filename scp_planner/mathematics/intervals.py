"""Arithmetic with intervals, vectorised: each operation encloses all values of its operands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array


@dataclass(frozen=True)
class Interval:
    """n intervals [lower, upper]."""

    lower: Array
    upper: Array

    @classmethod
    def around(cls, center: Array, radius: Array) -> Interval:
        """Return intervals from centres and half widths."""
        return cls(center - radius, center + radius)

    def __add__(self, other: Interval) -> Interval:
        return Interval(self.lower + other.lower, self.upper + other.upper)

    def __sub__(self, other: Interval) -> Interval:
        return Interval(self.lower - other.upper, self.upper - other.lower)

    def __neg__(self) -> Interval:
        return Interval(-self.upper, -self.lower)

    def __mul__(self, other: Interval) -> Interval:
        a, b = self.lower * other.lower, self.lower * other.upper
        c, d = self.upper * other.lower, self.upper * other.upper
        return Interval(np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d)))

    def times_positive(self, other: Interval) -> Interval:
        """Return the products with intervals of numbers that are not negative."""
        return Interval(
            np.minimum(self.lower * other.lower, self.lower * other.upper),
            np.maximum(self.upper * other.lower, self.upper * other.upper),
        )

    def scaled(self, factor: float) -> Interval:
        """Return the intervals times a number."""
        a, b = self.lower * factor, self.upper * factor
        return Interval(np.minimum(a, b), np.maximum(a, b))

    def squared(self) -> Interval:
        """Return the squares, never below 0."""
        a, b = self.lower * self.lower, self.upper * self.upper
        straddles = (self.lower < 0.0) & (self.upper > 0.0)
        return Interval(np.where(straddles, 0.0, np.minimum(a, b)), np.maximum(a, b))

    def power(self, exponent: float) -> Interval:
        """Return the powers of intervals of positive numbers, for a negative exponent."""
        return Interval(self.upper**exponent, self.lower**exponent)

    def magnitude(self) -> Array:
        """Largest absolute value in each interval."""
        return np.maximum(np.abs(self.lower), np.abs(self.upper))
