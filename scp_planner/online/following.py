"""How far a vehicle may be from where its plan has it, and where that is allowed for.

Of a tube (`scp_planner.estimation.tracking`) the part that there is even when the vehicle stands makes the vehicle
larger. What speed and turns add, certificates add piece by piece: who drives slowly, stops or stands is not kept as far
away as who drives fast. Trips are planned with room for the most that it can be, so that they are certified then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from scp_planner.estimation.tracking import TrackingTube
from scp_planner.scenario.models import Vehicle


@dataclass(frozen=True)
class Following:
    """How a vehicle follows its plan.

    Attributes
    ----------
    vehicle : Vehicle
        Larger by what it may be off when it stands.
    largest : float
        The most that it may be off, m.
    tube : TrackingTube or None
        What it may be off besides when it drives.
    """

    vehicle: Vehicle
    largest: float
    tube: TrackingTube | None = None

    @classmethod
    def of(cls, vehicle: Vehicle, largest: float, tube: TrackingTube | None) -> Following:
        """Return how a vehicle follows that is never farther off than so much, m, or stays in a tube.

        Parameters
        ----------
        vehicle : Vehicle
        largest : float
            m; 0 if there is a tube.
        tube : TrackingTube or None

        Returns
        -------
        Following

        Raises
        ------
        EstimationError
            If the vehicle may drive or turn faster than the tube was recorded for.
        """
        if tube is None:
            return cls(vehicle, largest)
        larger = vehicle.model_copy(update={"radius": vehicle.radius + tube.standing})
        return cls(larger, tube.bound(vehicle), replace(tube, standing=0.0))

    @property
    def room(self) -> float:
        """The most that it may be off besides when it drives, m."""
        return 0.0 if self.tube is None else self.tube.bound(self.vehicle)
