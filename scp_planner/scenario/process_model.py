"""Parameters of obstacles that change their minds: a motion with process noise, as fitted to recorded tracks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Discriminator, Field, Tag

from scp_planner import files
from scp_planner.errors import Fault, MotionModelError
from scp_planner.scenario.validation import (
    Objection,
    OfNumbers,
    OfParts,
    Part,
    Row,
    Rule,
    by_default,
    faults_of_named,
    part_of_file,
    variant,
)
from scp_planner.scenario.values import Count, Positive

SCHEMA_VERSION = 1
"""Version of scenario files, and of files of motion models."""


class RandomWalkVelocity(Part):
    """The velocity is a random walk: acceleration is white noise. The expected velocity stays."""

    kind: Literal["random_walk"] = "random_walk"
    diffusion: Positive = Field(description="growth of the variance of a velocity component, m2/s3")


class MeanRevertingVelocity(Part):
    """The velocity wanders about one that each obstacle keeps to, and comes back to it."""

    kind: Literal["mean_reverting"] = "mean_reverting"
    diffusion: Positive = Field(description="initial growth of the variance of a velocity component, m2/s3")
    time_constant: Positive = Field(description="of the return, s")


class SingerAcceleration(Part):
    """The acceleration wanders about zero (R. A. Singer, 1970): manoeuvres of a typical size and length."""

    kind: Literal["singer"] = "singer"
    deviation: Positive = Field(description="standard deviation of an acceleration component, m/s2")
    time_constant: Positive = Field(description="of a manoeuvre, s")


class RandomWalkAcceleration(Part):
    """The acceleration is a random walk: jerk is white noise. The expected acceleration stays."""

    kind: Literal["random_walk_acceleration"] = "random_walk_acceleration"
    diffusion: Positive = Field(description="growth of the variance of an acceleration component, m2/s5")
    acceleration_deviation: Positive = Field(description="of an acceleration component before anything was seen, m/s2")


_KINDS: dict[str, type[Part]] = {
    "random_walk": RandomWalkVelocity,
    "mean_reverting": MeanRevertingVelocity,
    "singer": SingerAcceleration,
    "random_walk_acceleration": RandomWalkAcceleration,
}


def _process_case(data: Any) -> str | None:
    if isinstance(data, Part):
        return next((variant(kind) for kind, part in _KINDS.items() if isinstance(data, part)), None)
    kind = data.get("kind") if isinstance(data, Mapping) else None
    return variant(kind) if isinstance(kind, str) and kind in _KINDS else None


Process = Annotated[
    Annotated[RandomWalkVelocity, Tag(variant("random_walk"))]
    | Annotated[MeanRevertingVelocity, Tag(variant("mean_reverting"))]
    | Annotated[SingerAcceleration, Tag(variant("singer"))]
    | Annotated[RandomWalkAcceleration, Tag(variant("random_walk_acceleration"))],
    Discriminator(
        _process_case,
        custom_error_type="process",
        custom_error_message=f"must be a mapping whose kind is one of {', '.join(_KINDS)}",
    ),
]


def _leads_increase(tails: Any) -> Iterator[Objection]:
    """Lead times are positive and increase, and each has its inflation."""
    leads = tails.lead_time
    for i, lead in enumerate(leads):
        if lead <= (leads[i - 1] if i else 0.0):
            yield Objection(("lead_time", i), lead, "must be positive and greater than the one before it")
    if len(tails.inflation) != len(leads):
        text = f"must have as many entries as lead_time, {len(leads)}, not {len(tails.inflation)}"
        yield Objection(("inflation",), tails.inflation, text)


class Tails(Part):
    """Difference between prediction errors of real obstacles and the normal ones of the model.

    The error at each lead time, the time since the last observation, is a Student vector: its covariance is
    the model's times an inflation, linear between the given lead times and constant beyond them.
    """

    rules: ClassVar[tuple[Rule, ...]] = (_leads_increase,)

    degrees_of_freedom: Positive = Field(description="of the Student distribution; small: heavy tails")
    lead_time: OfNumbers[Annotated[Row[Positive], Field(min_length=1)]] = Field(description="s, increasing")
    inflation: OfNumbers[Row[Positive]] = Field(description="of the covariance, one for each lead time")


class FittedTo(Part):
    """Data that a model was fitted to, for the reader of its file."""

    source: str = Field(default="", description="where the tracks came from")
    tracks: Count = Field(default=0, description="how many tracks")
    observations: Count = Field(default=0, description="how many positions in them")
    window: Count = Field(default=0, description="positions that predictions were from")


def also_a_file_name(schema: dict[str, Any]) -> None:
    """Let a JSON schema allow text where a file may name another one."""
    schema.setdefault("anyOf", []).append({"type": "string"})


def read_processes(data: Any, folder: Path) -> list[Fault]:
    """Put the contents of their files in the place of the names of process models in a scenario file."""
    faults = []
    obstacles = data.get("obstacles") if isinstance(data, dict) else None
    for i, obstacle in enumerate(obstacles if isinstance(obstacles, list) else ()):
        model = obstacle.get("model") if isinstance(obstacle, dict) else None
        if not isinstance(model, dict) or not isinstance(model.get("process"), str):
            continue
        name = model["process"]
        if not Path(name).suffix:
            continue
        place = f"obstacles[{i}].model.process"
        model["process"] = _STAND_IN  # one fault is enough
        try:
            model["process"] = ProcessModel.load(folder / name)
        except (OSError, MotionModelError) as error:
            faults += faults_of_named(place, name, error)
    return faults


def version_is_known(whole: Any) -> Iterator[Objection]:
    """`schema` is a version that this package reads."""
    if whole.schema_ != SCHEMA_VERSION:
        yield Objection(("schema",), whole.schema_, f"must be {SCHEMA_VERSION}")


class ProcessModel(Part):
    """A motion with process noise and its parameters.

    Raises
    ------
    ScenarioError
        If built from wrong values; with every fault.
    """

    rules: ClassVar[tuple[Rule, ...]] = (version_is_known,)

    schema_: Annotated[int, Field(strict=True)] = Field(
        default=1,
        validation_alias="schema",
        serialization_alias="schema",
        description="version of this format: 1",
        json_schema_extra={"const": 1},
    )
    process: OfParts[Process]
    velocity_deviation: Positive = Field(description="of a velocity component before anything was seen, m/s")
    noise_deviation: Positive = Field(description="of an observation that comes without a covariance, m")
    max_speed: Positive | None = by_default(None, description="that predictions never exceed, m/s; null: none")
    max_acceleration: Positive | None = by_default(None, description="that predictions never exceed, m/s2; null: none")
    tails: OfParts[Tails | None] = by_default(None, description="heavy tails; null: normal errors")
    fitted_to: OfParts[FittedTo | None] = by_default(None, description="for the reader")

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a model from a YAML or JSON file.

        Parameters
        ----------
        path : path

        Returns
        -------
        ProcessModel

        Raises
        ------
        MotionModelError
            With every fault of the file.
        OSError
            If the file cannot be read.
        """
        data, faults = files.read(path, MotionModelError)
        return part_of_file(cls, path, data, MotionModelError, faults=faults)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the model so that `load` gives an equal one; the file is replaced whole or not at all."""
        files.write(path, self.model_dump(mode="json", by_alias=True))


_STAND_IN = ProcessModel(
    process=RandomWalkVelocity(diffusion=1.0), velocity_deviation=1.0, noise_deviation=1.0, tails=None
)
