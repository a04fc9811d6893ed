"""To how many digits that is rounded which plans are made with: the same on every machine."""

from __future__ import annotations

ANGLE_DECIMALS = 10  # of rad: what is planned with is rounded, see ZoneBatch.rounded

DECIMALS = 7  # of m, to which what is planned with is rounded

DIGITS = 12  # that count, of limits


def to_digits(value: float) -> float:
    """Return a number with the digits that count of a limit; it may be infinite."""
    return float(f"{value:.{DIGITS - 1}e}")
