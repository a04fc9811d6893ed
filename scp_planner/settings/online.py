"""Settings and outcomes of planning while driving."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Annotated

from scp_planner.settings.knobs import Above, Choice, Knobs, Range
from scp_planner.settings.planning import LARGEST, decided
from scp_planner.units import Units

RARE = 1e-6
"""Probability below which a window is improbable. Ten times that would notice a change a thirtieth sooner only."""


@dataclass(frozen=True)
class Newcomers(Knobs):
    """Priors of tentative tracks: of obstacles with too few observations to estimate their motion.

    Attributes
    ----------
    velocity_deviation : float or None
        Standard deviation of each component of the velocity. Larger: wider zones at first. None: half of the vehicle's
        top speed.
    acceleration_deviation : float or None
        Standard deviation of each component of the acceleration. Larger: zones that grow faster at first. None: 0.5
        units.
    noise_deviation : float or None
        Standard deviation of an observed coordinate, where it is unknown and there are too few observations to estimate
        it. None: 0.1 units.
    """

    velocity_deviation: Annotated[float | None, Above(0.0, LARGEST, "m/s")] = None
    acceleration_deviation: Annotated[float | None, Above(0.0, LARGEST, "m/s2")] = None
    noise_deviation: Annotated[float | None, Above(0.0, LARGEST, "m")] = None


@dataclass(frozen=True)
class SceneNewcomers(Newcomers):
    """:class:`Newcomers` with nothing left open, in the units of a scene."""

    velocity_deviation: Annotated[float, Range(1e-6, 1000.0)] = 1.5
    acceleration_deviation: Annotated[float, Range(1e-6, 1000.0)] = 0.5
    noise_deviation: Annotated[float, Range(1e-6, 1000.0)] = 0.1


class Safety(StrEnum):
    """Certificate that a plan needs before it is driven."""

    STOP = "stop"
    """The trip up to a time at or after the next replan, and a stop from there."""
    TRIP = "trip"
    """The trip up to the goal."""


class GiveWay(StrEnum):
    """Condition of an evasive manoeuvre."""

    LATE = "late"
    """Only if no trip can be left for a stop that stays clear."""
    EARLY = "early"
    """Also where a short trip leads nearly as far and keeps farther away."""


class Regions(StrEnum):
    """Source of the sizes of zones."""

    MODEL = "model"
    """The estimated motion, after change detection."""
    ADAPTIVE = "adaptive"
    """The estimated motion and its coverage so far, by obstacle and horizon; see `scp_planner.tracking.conformal`."""


@dataclass(frozen=True)
class OnlineSettings(Knobs):
    """Settings of :class:`scp_planner.Planner`.

    Units are those of the scene, see :class:`scp_planner.Settings`.

    Attributes
    ----------
    period : float or None
        Longest time between two replans. A plan is safe until the next one, so longer: more caution. None: 0.1 units,
        or longer if the last replans came later.
    tracking_error : float
        Largest distance between the vehicle and its planned position. Zones are larger by this.
    speed_error : float or None
        Largest difference between the speed of the vehicle and that of its plan, with which it still keeps to
        ``tracking_error``. None: the largest one with which a stop from top speed stays within ``tracking_error``.
    heading_error : float or None
        Largest difference between the heading of the vehicle and that of its plan; None: as ``speed_error``. Beyond
        these the next plan begins at the reported state.
    arrival_tolerance : float or None
        Distance from a goal, beyond its radius and ``tracking_error``, at which a vehicle arrives that has left its
        plan. None: the distance of one period at top speed where the goal has neither radius nor region, else 0.
    reaction_time : float
        Time from a replan until the vehicle follows it. Zones are larger by ``reaction_time * max_speed`` too, the
        distance driven before it brakes. Where the jerk is limited, a plan begins so much later, on the last plan.
    safety : Safety
        Certificate that a plan needs before it is driven: ``stop``, a stop at any time; ``trip``, all of the trip.
    stay_clear : float or None
        Time for which no zone may reach the vehicle after it stands, for a stop to be safe; without such a stop the
        vehicle evades. Longer: more caution, and more evasive manoeuvres; 0: a standing vehicle counts as safe. None:
        the time in which, from standing, it drives four times its own width.
    give_way : GiveWay or None
        Condition of an evasive manoeuvre: ``late``, where no trip can be left for a stop that stays clear; ``early``,
        also where a short trip leads nearly as far and keeps farther away. None: ``early`` among obstacles that wander
        about a velocity of their own, as those of the model ``pedestrian``, else ``late``.
    foresight : float or None
        Time ahead for which zones grow; beyond it they assume future measurements, see
        `scp_planner.prediction.foresight`. None: the time to react, to the next replan and to stop, and somewhat more,
        since a stop need not begin at once.
    iterations : int
        Steps of the loop in one replan, at most; one is enough where it ends clear of all zones, and half as many where
        the vehicle is on its plan. More: better plans sooner, and longer replans.
    improve_every : int
        Replans from one improvement of the plan to the next; half as many while it does not keep all limits yet. In
        between it is kept while it holds, with a new stop. Larger: less work, and a plan that follows measurements a
        little later.
    look_every : int
        Replans from one search for alternative routes to the next, while one could be faster enough to change. Smaller:
        alternatives are found sooner, and more work.
    look_iterations : int
        Steps of the loop from an alternative route, at most. More: routes that need more work are found too.
    look_steps : int
        Steps of the loop from alternative routes in one replan, one less while there is a plan to drive: a search is
        spread over several. More: alternatives are found sooner, and longer replans.
    first_runs : int
        Starts of the loop for a first plan, at most.
    reserve : float
        Time on the computer's clock before the deadline that is kept for the fallback.
    newcomers : Newcomers
        Priors of tentative tracks: of obstacles with too few observations to estimate their motion.
    gate_probability : float
        An observation less probable than this is left out, see `scp_planner.prediction.obstacle_tracks`.
    alarm_probability : float
        A window of observations less probable than this is an alarm: then zones follow a motion with more process
        noise, see `scp_planner.tracking.noticing`. 0: no alarms, and the declared sensor noise is not corrected.
    manoeuvre : float
        Standard deviation of a change of acceleration that an obstacle may begin at any time, as a multiple of that
        of tentative tracks. Larger: zones that grow faster, and slower trips.
    changes : float
        Assumed rate of changes of an obstacle's acceleration, per unit of time of the scene. Larger: zones allow for a
        change sooner, and for more false ones, see `scp_planner.tracking.change_hypotheses`. 0: only after an alarm.
    regions : Regions
        Source of the sizes of zones: ``model``, the estimated motion; ``adaptive``, that and its coverage so far, so
        that the level is kept in the long run, see `scp_planner.tracking.conformal`.
    forget_after : float
        An obstacle without observations for so long is forgotten.
    """

    period: Annotated[float | None, Above(0.0, LARGEST, "s")] = None
    tracking_error: Annotated[float, Range(0.0, LARGEST, "m")] = 0.0
    speed_error: Annotated[float | None, Range(0.0, LARGEST, "m/s")] = None
    heading_error: Annotated[float | None, Range(0.0, math.pi, "rad")] = None
    arrival_tolerance: Annotated[float | None, Range(0.0, LARGEST, "m")] = None
    reaction_time: Annotated[float, Range(0.0, LARGEST, "s")] = 0.0
    safety: Annotated[Safety | str, Choice(Safety)] = Safety.STOP
    stay_clear: Annotated[float | None, Range(0.0, LARGEST, "s")] = None
    give_way: Annotated[GiveWay | str | None, Choice(GiveWay)] = None
    foresight: Annotated[float | None, Range(0.0, unit="s")] = None
    iterations: Annotated[int, Range(1, 1000)] = 2
    improve_every: Annotated[int, Range(1, 1000)] = 5
    look_every: Annotated[int, Range(1, 1_000_000)] = 10
    look_iterations: Annotated[int, Range(1, 1000)] = 16
    look_steps: Annotated[int, Range(1, 1000)] = 4
    first_runs: Annotated[int, Range(1, 1000)] = 4
    reserve: Annotated[float, Range(0.0, 60.0, "s")] = 5e-3
    newcomers: Newcomers = field(default_factory=Newcomers)
    gate_probability: Annotated[float, Range(0.0, 0.5)] = 1e-7
    alarm_probability: Annotated[float, Range(0.0, 0.1)] = RARE
    manoeuvre: Annotated[float, Range(0.0, 1000.0)] = 0.03
    changes: Annotated[float, Range(0.0, 1000.0)] = 0.02
    regions: Annotated[Regions | str, Choice(Regions)] = Regions.ADAPTIVE
    forget_after: Annotated[float, Range(0.0, unit="s")] = math.inf

    def for_scene(self, units: Units) -> SceneOnlineSettings:
        """Return the settings for a scene: what they leave open as the scene decides.

        Parameters
        ----------
        units : Units
            Of the scene.

        Returns
        -------
        SceneOnlineSettings

        Raises
        ------
        SettingsError
            With every length and time that is too small or too large for the scene.
        """
        newcomers = decided(self.newcomers, Newcomers, SceneNewcomers, units)
        return decided(replace(self, newcomers=newcomers), OnlineSettings, SceneOnlineSettings, units)

    def margin(self, max_speed: float) -> float:
        """Margin added to zones, m: tracking error, and the way that the vehicle drives in its reaction time."""
        return self.tracking_error + self.reaction_time * max_speed


@dataclass(frozen=True)
class SceneOnlineSettings(OnlineSettings):
    """:class:`OnlineSettings` with nothing left open, in the units of a scene but for ``reserve``."""

    period: Annotated[float, Range(1e-3, 1000.0)] = 0.1
    tracking_error: Annotated[float, Range(0.0, 10.0)] = 0.0
    reaction_time: Annotated[float, Range(0.0, 10.0)] = 0.0
    newcomers: SceneNewcomers = field(default_factory=SceneNewcomers)
