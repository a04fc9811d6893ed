"""The closed loop: sensors look, the planner replans, the vehicle drives, the obstacles move."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Unpack

from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.online import OnlineSettings
from scp_planner.simulation.drive import Drive
from scp_planner.simulation.run import Run
from scp_planner.simulation.sensors import Sensor
from scp_planner.simulation.setup import Follower, SimulationChoices, SimulationSettings, check_choices, world_of
from scp_planner.threat_zones.target import tracked


@dataclass(frozen=True)
class LoopDefaults:
    """Defaults of a closed loop, in the scene's units."""

    noise: float = 0.1  # Units of length of the scene
    rate: float = 10.0  # In a unit of time
    # Units of time of observations before the start: what a sensor has seen when the vehicle sets off
    history: float = 10.0
    # Units of time after which a run ends, or four times the trip without obstacles if that is longer
    time_limit: float = 60.0
    # Units of time after which an obstacle that is not seen has gone, unless other settings are given
    forget_after: float = 2.0


DEFAULTS = LoopDefaults()


def simulate(
    scenario: Scenario,
    noise: float | None = None,
    rate: float | None = None,
    seed: int = 0,
    *,
    setup: SimulationSettings | None = None,
    progress: Callable[[float], None] | None = None,
    **choices: Unpack[SimulationChoices],
) -> Run:
    """Drive a scenario in a closed loop.

    Parameters
    ----------
    scenario : Scenario
        Obstacles with a ``motion`` really move like that, and are observed with noise; of those with observations, the
        truth is drawn from what the observations leave open.
    noise : float, optional
        Standard deviation of each coordinate of an observed position, m. By default 0.1 units of length of the scene,
        see :class:`scp_planner.Settings`.
    rate : float, optional
        Looks and replans per second, Hz. By default 10 in a unit of time of the scene.
    seed : int
    setup : SimulationSettings, optional
        What obstacles really do, sensors, how the vehicle follows, the planner's settings, and when the run ends.
    progress : callable, optional
        Called after each cycle with the time driven so far, s.
    **choices
        Fields of :class:`scp_planner.SimulationSettings`, such as ``world`` or ``online``: in place of those of
        ``setup``.

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        If a value is not allowed.
    TypeError
        If there is no such field.
    """
    units, scenario = NaturalUnits.of(scenario), tracked(scenario)
    chosen = replace(setup or SimulationSettings(), **choices)
    noise = DEFAULTS.noise * units.length if noise is None else noise
    rate = DEFAULTS.rate / units.time if rate is None else rate
    history = DEFAULTS.history * units.time if chosen.history is None else chosen.history
    check_choices(noise, rate, history, seed)
    follower = chosen.follower or Follower()
    online = chosen.online or OnlineSettings(
        tracking_error=follower.tracking_error,
        reaction_time=follower.reaction_time,
        forget_after=DEFAULTS.forget_after * units.time,
    )
    drive = Drive(
        scenario,
        int(seed),
        world_of(scenario, chosen.world, int(seed)),
        tuple(chosen.sensors) if chosen.sensors is not None else (Sensor(rate=rate, noise=noise),),
        follower,
        replace(online, period=1.0 / rate),
        history,
        chosen,
    )
    time_limit = chosen.time_limit
    if time_limit is None:
        trip = math.dist(scenario.start.position, scenario.goal.position) / scenario.vehicle.max_speed
        time_limit = max(DEFAULTS.time_limit * units.time, 4.0 * trip)
    return drive.run(time_limit, progress)
