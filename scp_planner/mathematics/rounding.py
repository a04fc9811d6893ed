"""To how many digits that is rounded which plans are made with: the same on every machine."""

from __future__ import annotations

ANGLE_DECIMALS = 10  # of rad: what is planned with is rounded, see ZoneBatch.rounded

DECIMALS = 7  # of m, to which what is planned with is rounded
