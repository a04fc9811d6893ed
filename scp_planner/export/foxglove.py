"""Runs as scenes for Foxglove, in MCAP files, by the messages of its own package."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.export.ros import BODY, FRAME, NANOSECONDS
from scp_planner.files import replacing
from scp_planner.mathematics.corridor import NAME, WALLS
from scp_planner.threat_zones.boundaries import boundaries_of

if TYPE_CHECKING:
    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario
    from scp_planner.simulation.cycle import Cycle
    from scp_planner.simulation.run import Run

_COLOURS = {"vehicle": (0.13, 0.13, 0.13), "plan": (0.0, 0.45, 0.7), "zone": (0.84, 0.37, 0.0), "wall": (0.5, 0.5, 0.5)}
_SAMPLES = 50


def save_scene(
    run: Run, path: str | PathLike[str], *, frame: str = FRAME, body: str = BODY, epoch: float = 0.0
) -> None:
    """Write a run, or a recording that was loaded as one, as an MCAP file that Foxglove shows as it is.

    ``/scene``, ``foxglove.SceneUpdate``, at each replan: zones with the ids of their obstacles, the plan, the vehicle
    and the walls; ``/tf``, ``foxglove.FrameTransform``, of the vehicle; ``/replan``, JSON: outcome, reason, its code
    and obstacle, whether it is safe, the wall time, s, and a line for each candidate.

    Parameters
    ----------
    run : Run
    path : path
        .mcap
    frame, body : str
        Names of the frame that positions are in and of the vehicle.
    epoch : float
        Time of the file at time 0 of the run, s.

    Raises
    ------
    ImportError
        If `foxglove-sdk` is not installed.
    """
    scenarios = (run.scenario, *run.changes)
    scene = Scene(frame=frame, body=body, epoch=epoch)
    with replacing(path) as temporary, scene.foxglove.open_mcap(temporary, allow_overwrite=True, context=scene.context):
        for cycle, plan in zip(run.records, run.plans, strict=True):
            begun = [each for each in scenarios if each.start.time < cycle.time]  # told after a replan then
            scene.replan(cycle, plan, begun[-1] if begun else run.scenario)


class Scene:
    """Channels of a scene, and what they show; names and times as of `save_scene`."""

    def __init__(self, *, frame: str = FRAME, body: str = BODY, epoch: float = 0.0) -> None:
        try:
            import foxglove
            from foxglove import channels, messages
        except ImportError as error:
            raise ImportError("scenes need foxglove-sdk: pip install 'scp-planner[foxglove]'") from error
        self.foxglove, self.context = foxglove, foxglove.Context()
        self._messages, self._making = messages, _Making(messages, frame)
        self._body, self._epoch = body, epoch
        self._scene = channels.SceneUpdateChannel("/scene", context=self.context)
        self._transform = channels.FrameTransformChannel("/tf", context=self.context)
        self._replans = foxglove.Channel("/replan", context=self.context)

    def replan(self, cycle: Cycle, plan: Plan, scenario: Scenario) -> None:
        """Show a replan."""
        making, stamp = self._making, round((cycle.time + self._epoch) * NANOSECONDS)
        left = np.linspace(cycle.time, max(cycle.time, plan.arrival_time), _SAMPLES)
        zones = list(dict.fromkeys(zone.id for zone in cycle.zones if zone.id not in (NAME, WALLS)))
        walls = {f"wall {k}": making.line(wall, "wall", closed=True) for k, wall in enumerate(scenario.walls)}
        entities = [
            making.entity("plan", stamp, lines=[making.line(plan.position(left), "plan")]),
            *(making.zone(cycle, name, stamp) for name in zones),
            *(making.entity(name, stamp, lines=[line]) for name, line in walls.items()),
            making.vehicle(self._body, stamp, scenario.vehicle),
        ]
        gone = making.gone([*zones, *walls], stamp)  # walls are sent each time, for viewers that connect later
        self._scene.log(self._messages.SceneUpdate(deletions=gone, entities=entities), log_time=stamp)
        self._transform.log(making.transform(cycle, self._body, stamp), log_time=stamp)
        told = {"outcome": cycle.outcome, "safe": cycle.safe, "code": cycle.code, "reason": cycle.reason}
        told |= {"obstacle": cycle.obstacle, "wall_time": cycle.wall_time, "candidates": list(cycle.candidates)}
        self._replans.log(told, log_time=stamp)


class LiveScene(Scene):
    """A scene that is served at ws://127.0.0.1:8765 until it is closed."""

    def __init__(self) -> None:
        super().__init__()
        self._server = self.foxglove.start_server(name="scp_planner", context=self.context)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()


class _Making:
    """Makes messages of one frame; remembers which zones are shown."""

    def __init__(self, messages: Any, frame: str) -> None:
        self.messages, self.frame = messages, frame
        self._shown: list[str] = []

    def entity(self, name: str, stamp: int, *, frame: str | None = None, **parts: Any) -> Any:
        locked = frame is not None
        return self.messages.SceneEntity(
            id=name, timestamp=self._time(stamp), frame_id=frame or self.frame, frame_locked=locked, **parts
        )

    def line(self, points: Any, look: str, *, closed: bool = False) -> Any:
        made = [self.messages.Point3(x=float(x), y=float(y), z=0.0) for x, y in points]
        kind = self.messages.LinePrimitiveLineType
        return self.messages.LinePrimitive(
            type=kind.LineLoop if closed else kind.LineStrip,
            thickness=2.0,
            scale_invariant=True,
            points=made,
            color=self._colour(look),
        )

    def zone(self, cycle: Cycle, name: str, stamp: int) -> Any:
        several = [zone for zone in cycle.zones if zone.id == name]
        now = np.array([cycle.time])
        center: Array = several[0].center(now)[0]
        pieces = center + boundaries_of(several, now)[0]
        text = self.messages.TextPrimitive(
            pose=self._pose(*center.tolist()),
            billboard=True,
            font_size=14.0,
            scale_invariant=True,
            color=self._colour("zone"),
            text=name,
        )
        return self.entity(name, stamp, lines=[self.line(each, "zone", closed=True) for each in pieces], texts=[text])

    def vehicle(self, body: str, stamp: int, vehicle: Any) -> Any:
        side = 2.0 * vehicle.radius
        size = self.messages.Vector3(x=side, y=side, z=0.1)
        discs = [
            self.messages.CylinderPrimitive(
                pose=self._pose(ahead, 0.0), size=size, bottom_scale=1.0, top_scale=1.0, color=self._colour("vehicle")
            )
            for ahead in vehicle.discs
        ]
        return self.entity("vehicle", stamp, frame=body, cylinders=discs)

    def gone(self, names: list[str], stamp: int) -> list[Any]:
        """Deletions of what was shown and is no more."""
        old = [name for name in self._shown if name not in names]
        self._shown = names
        kind = self.messages.SceneEntityDeletionType.MatchingId
        return [self.messages.SceneEntityDeletion(type=kind, id=name, timestamp=self._time(stamp)) for name in old]

    def transform(self, cycle: Cycle, body: str, stamp: int) -> Any:
        half = 0.5 * cycle.heading
        return self.messages.FrameTransform(
            timestamp=self._time(stamp),
            parent_frame_id=self.frame,
            child_frame_id=body,
            translation=self.messages.Vector3(x=cycle.position[0], y=cycle.position[1], z=0.0),
            rotation=self.messages.Quaternion(x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half))),
        )

    def _pose(self, x: float, y: float) -> Any:
        none = self.messages.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
        return self.messages.Pose(position=self.messages.Vector3(x=x, y=y, z=0.0), orientation=none)

    def _time(self, stamp: int) -> Any:
        return self.messages.Timestamp(*divmod(stamp, NANOSECONDS))

    def _colour(self, look: str) -> Any:
        red, green, blue = _COLOURS[look]
        return self.messages.Color(r=red, g=green, b=blue, a=1.0)
