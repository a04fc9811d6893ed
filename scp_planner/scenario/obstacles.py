"""Obstacles: their observations, the model of their motion, and how each is given."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import BeforeValidator, ConfigDict, Field

from scp_planner.scenario import obstacle_checks, ready_made
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.motions import Covariance, GivenMotion
from scp_planner.scenario.obstacle_checks import WHEREABOUTS
from scp_planner.scenario.process_model import ProcessModel, also_a_file_name
from scp_planner.scenario.shapes import SHAPE_KEYS, Shape
from scp_planner.scenario.validation import Numbers, OfNumbers, OfParts, Part, Row, Rule, TakenAs, by_default
from scp_planner.scenario.values import NotNegative, Number, Positive, Rate, Text, Vector


class Observations(Part):
    """Noisy positions of one obstacle."""

    rules: ClassVar[tuple[Rule, ...]] = (
        obstacle_checks.times_increase,
        obstacle_checks.one_position_a_time,
        obstacle_checks.covariance_is_one_or_each,
        obstacle_checks.covariance_is_definite,
    )

    time: OfNumbers[Row[Number]] = Field(description="s, increasing")
    position: OfNumbers[Row[Vector]] = Field(description="[[x, y], ...], m, one for each time")
    covariance: TakenAs[Covariance | None, Numbers | None] = by_default(
        None, description="of one observation [[xx, xy], [xy, yy]], or one matrix for each, m2; null: estimated"
    )


class Prior(Part):
    """Independent normal priors of velocity and acceleration at the time of the last observation."""

    rules: ClassVar[tuple[Rule, ...]] = (obstacle_checks.prior_says_something,)

    velocity: OfNumbers[Rate] = by_default((0.0, 0.0), description="expected [x, y], m/s")
    velocity_deviation: Positive | None = Field(default=None, description="of each component, m/s; null: unknown")
    acceleration: OfNumbers[Rate] = by_default((0.0, 0.0), description="expected [x, y], m/s2")
    acceleration_deviation: Positive | None = Field(default=None, description="of each component, m/s2; null: unknown")


class Model(Part):
    """Motion model that the estimate assumes.

    Where one is wanted, the name of a ready-made one will do: pedestrian, cyclist, car, ship or drone.
    """

    rules: ClassVar[tuple[Rule, ...]] = (obstacle_checks.prior_or_process,)

    order: Annotated[int, Field(strict=True, ge=0, le=2)] = Field(
        default=2, description="0 standing, 1 constant velocity, 2 constant acceleration"
    )
    prior: OfParts[Prior | None] = by_default(None, description="of velocity and acceleration; null: none")
    manoeuvre: NotNegative = Field(
        default=0.0,
        description="standard deviation of each component of a change of acceleration that may begin with the last"
        " observation, m/s2",
    )
    process: TakenAs[
        Annotated[ProcessModel | None, BeforeValidator(ready_made.process_by_name)],
        ProcessModel | Mapping[str, Any] | str | None,
    ] = by_default(
        None,
        description="motion with process noise in place of order and prior, or the name of its file beside this"
        " one, or of a ready-made one; null: none",
        json_schema_extra=also_a_file_name,
    )

    max_speed: Positive | None = by_default(
        None, description="that predictions never exceed, m/s; null: that of process, if there is one"
    )
    max_acceleration: Positive | None = by_default(
        None, description="that predictions never exceed, m/s2; null: that of process, if there is one"
    )

    @property
    def bounds(self) -> tuple[float, float]:
        """Largest speed, m/s, and acceleration, m/s2, inf where there is none."""
        speed, acceleration = self.max_speed, self.max_acceleration
        if self.process is not None:
            speed, acceleration = speed or self.process.max_speed, acceleration or self.process.max_acceleration
        return speed or math.inf, acceleration or math.inf

    @classmethod
    def named(cls, name: str) -> Self:
        """Give a ready-made model, fitted to recorded tracks or from published figures.

        Parameters
        ----------
        name : str
            ``"pedestrian"``, ``"cyclist"``, ``"car"``, ``"ship"`` or ``"drone"``.

        Returns
        -------
        Model

        Raises
        ------
        ValueError
            If there is none of that name.
        """
        return cls(process=ready_made.ready_made(name))


OfModel = TakenAs[Annotated[Model, BeforeValidator(ready_made.model_by_name)], Model | Mapping[str, Any] | str]


def any_model() -> Any:
    """Describe the field of the model of a motion to estimate."""
    text = f"of the motion to estimate, or one of the words {', '.join(ready_made.NAMES)}"
    return by_default(Model(), description=text, json_schema_extra=ready_made.or_its_name)


class Obstacle(Part):
    """Something to keep clear of: its shape, and its motion, observations of it, or what a tracker says of it."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [
                {
                    "required": [key],
                    "properties": {
                        each: {"type": "object" if each == key else "null"} for each in obstacle_checks.WHEREABOUTS
                    },
                }
                for key in WHEREABOUTS
            ]
        }
    )
    rules: ClassVar[tuple[Rule, ...]] = (
        obstacle_checks.one_is_given(WHEREABOUTS, "either motion or observations or an estimate"),
        obstacle_checks.enough_observations,
        obstacle_checks.no_prior_of_an_estimate,
    )

    id: Text = Field(description="text, unique")
    shape: OfParts[Shape] = Field(description=f"{{one of {', '.join(SHAPE_KEYS)}: size}}")
    motion: OfParts[GivenMotion | None] = by_default(
        None, description="known exactly, or predicted; {futures: [...]}: several that are possible"
    )
    observations: OfParts[Observations | None] = by_default(None, description="from which the motion is estimated")
    estimate: OfParts[Estimate | None] = by_default(
        None, description="what a tracker says, from which the motion is predicted"
    )
    model: OfModel = any_model()
    margin: NotNegative = Field(default=0.0, description="extra clearance, m")
