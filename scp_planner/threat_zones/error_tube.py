"""Tube round the planned position, calibrated from recorded drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.threat_zones.tolerances import TUBE_TOLERANCE
from scp_planner.tracking.conformal import conformal_quantile

if TYPE_CHECKING:
    from scp_planner.scenario.models import Vehicle
    from scp_planner.scenario.units import NaturalUnits

LEAST_FORM = 0.01
"""Least value of the form, relative to the mean error."""


@dataclass(frozen=True, eq=False)
class TrackingRecord:
    """One recorded drive: what was planned, and how far the vehicle was from it.

    Parameters
    ----------
    speed : (n,) array
        Planned, m/s.
    lateral : (n,) array
        Planned speed^2 * |curvature|, m/s2.
    error : (n,) array
        Distance between the vehicle and where its plan had it, m.

    Raises
    ------
    EstimationError
        If the arrays do not belong together, are empty, or hold something else than numbers of at least 0.
    """

    speed: Array
    lateral: Array
    error: Array

    def __post_init__(self) -> None:
        for name in ("speed", "lateral", "error"):
            values = np.asarray(getattr(self, name), dtype=float)
            object.__setattr__(self, name, values)
            if values.ndim != 1 or not len(values) or values.shape != np.shape(self.speed):
                raise EstimationError(f"{name}: shape {values.shape}; must be (n,), n > 0, as that of the speed")
            if not np.all(np.isfinite(values) & (values >= 0.0)):
                raise EstimationError(f"{name}: must hold finite numbers of at least 0")

    @classmethod
    def of(cls, speed: ArrayLike, curvature: ArrayLike, planned: ArrayLike, driven: ArrayLike) -> Self:
        """Return the record of a drive from what was planned and where the vehicle was.

        Parameters
        ----------
        speed, curvature : (n,)
            Planned, m/s and 1/m.
        planned, driven : (n, 2)
            Positions at the same times, m.

        Returns
        -------
        TrackingRecord

        Raises
        ------
        EstimationError
            As the record itself.
        """
        pace, apart = np.asarray(speed, dtype=float), np.subtract(driven, planned)
        if apart.ndim != 2 or apart.shape[1] != 2:
            raise EstimationError(f"planned, driven: shape {apart.shape}; must be (n, 2)")
        return cls(pace, pace**2 * np.abs(np.asarray(curvature, dtype=float)), np.hypot(apart[:, 0], apart[:, 1]))


@dataclass(frozen=True)
class TrackingTube:
    """Radius of the tube round a plan that the vehicle stays in; see the head of this module.

    Attributes
    ----------
    standing : float
        m.
    per_speed : float
        m per m/s.
    per_lateral : float
        m per m/s2.
    max_speed, max_lateral : float
        Up to which it was recorded, m/s and m/s2.
    probability : float
        The probability with which a whole drive stays inside, at least.
    records : int
        Drives that its size was calibrated with.
    """

    standing: float
    per_speed: float
    per_lateral: float
    max_speed: float
    max_lateral: float
    probability: float
    records: int

    def radius(self, speed: ArrayLike, lateral: ArrayLike) -> Array:
        """Return the radius at planned speeds and lateral accelerations.

        Parameters
        ----------
        speed, lateral : (n,)
            m/s and m/s2, not negative; or one number each.

        Returns
        -------
        (n,) array
            m.

        Raises
        ------
        EstimationError
            If one is larger than any that was recorded, or no number of at least 0.
        """
        pace, turn = np.asarray(speed, dtype=float), np.asarray(lateral, dtype=float)
        for name, values, most in (("speed", pace, self.max_speed), ("lateral", turn, self.max_lateral)):
            if not np.all((values >= 0.0) & (values <= most * (1.0 + TUBE_TOLERANCE))):
                raise EstimationError(f"{name}: must be from 0 to {most:g}, the largest one recorded")
        return self.standing + self.per_speed * pace + self.per_lateral * turn

    def inside(self, units: NaturalUnits) -> TrackingTube:
        """Return the tube in the units of a scene."""
        return replace(
            self,
            standing=self.standing / units.length,
            per_speed=self.per_speed / units.time,
            per_lateral=self.per_lateral / (units.time * units.time),
            max_speed=self.max_speed / units.speed,
            max_lateral=self.max_lateral / units.factor("m/s2"),
        )

    def bound(self, vehicle: Vehicle) -> float:
        """Return the largest radius over all that a vehicle may do.

        Parameters
        ----------
        vehicle : Vehicle
            Its top speed and, if it has one, its limit of the lateral acceleration or of the curvature.

        Returns
        -------
        float
            m, for ``OnlineSettings.tracking_error``.

        Raises
        ------
        EstimationError
            If the vehicle may drive or turn faster than was recorded.
        """
        limits = [np.inf if vehicle.max_lateral_acceleration is None else vehicle.max_lateral_acceleration]
        if vehicle.max_curvature is not None:
            limits.append(vehicle.max_speed**2 * vehicle.max_curvature)
        return float(self.radius(vehicle.max_speed, min(limits)))


def fit_tracking_tube(records: Sequence[TrackingRecord], probability: float = 0.95) -> TrackingTube:
    """Calibrate a tube from recorded drives.

    Parameters
    ----------
    records : sequence of TrackingRecord
        One for each drive. Every other one shapes the tube, the rest sets its size.
    probability : float
        The probability with which a whole new drive stays inside, at least.

    Returns
    -------
    TrackingTube

    Raises
    ------
    EstimationError
        If the probability is not between 0 and 1, there are too few drives for it, or no error was recorded at all.
    """
    from scipy.optimize import nnls

    if not 0.0 < probability < 1.0:
        raise EstimationError(f"probability: {probability!r} is not between 0 and 1")
    shaping, sizing = records[0::2], records[1::2]
    if not sizing:
        raise EstimationError(f"records: {len(records)} drives are too few; one half shapes the tube, one sizes it")
    errors = np.concatenate([one.error for one in shaping])
    if not errors.any():
        raise EstimationError("records: every other drive, which shapes the tube, has no error at all")
    columns = np.concatenate([_columns(one) for one in shaping])
    largest = np.maximum(columns.max(axis=0), np.finfo(float).tiny)  # so that each counts by what it can add
    form = nnls(columns / largest, errors)[0] / largest
    form[0] = max(form[0], LEAST_FORM * float(errors.mean()))
    ratios = [float((one.error / (_columns(one) @ form)).max()) for one in sizing]
    scale = conformal_quantile(ratios, 1.0 - probability)
    if not np.isfinite(scale):
        least = 2 * int(np.ceil(probability / (1.0 - probability) - TUBE_TOLERANCE))
        raise EstimationError(f"records: {len(records)} drives are too few for {probability:g}; it takes {least}")
    standing, per_speed, per_lateral = (scale * form).tolist()
    return TrackingTube(
        standing,
        per_speed,
        per_lateral,
        max_speed=max(float(one.speed.max()) for one in records),
        max_lateral=max(float(one.lateral.max()) for one in records),
        probability=probability,
        records=len(sizing),
    )


def _columns(record: TrackingRecord) -> Array:
    return np.stack([np.ones_like(record.speed), record.speed, record.lateral], axis=1)
