"""Scenes for Foxglove: read by other packages, by the schemas of Foxglove's own."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.export import save_scene


def read(path: Path) -> list[tuple[Any, str, Any]]:
    """Schema, topic and message of each that is in a file."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return [(schema, channel.topic, message) for schema, channel, message in make_reader(file).iter_messages()]


def decoded(schema: Any, data: bytes) -> Any:
    """A message by the schema that Foxglove's package wrote into the file."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    kind = message_factory.MessageFactory(pool).GetPrototype(pool.FindMessageTypeByName(schema.name))
    return kind.FromString(data)


def test_scenes_hold_what_was_planned(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    wall = [[3.0, 2.0], [5.0, 2.0], [5.0, 3.0], [3.0, 3.0]]
    scenario = scene(disc("ship", (8.0, -3.0), (0.0, 0.8)), goal={"position": [8.0, 0.0]}, walls=[wall])
    run = sp.simulate(scenario, noise=0.02, rate=4.0)
    save_scene(run, tmp_path / "run.mcap", epoch=1.7e9)

    found = read(tmp_path / "run.mcap")
    scenes = [decoded(schema, message.data) for schema, topic, message in found if topic == "/scene"]
    places = [decoded(schema, message.data) for schema, topic, message in found if topic == "/tf"]
    told = [json.loads(message.data) for _, topic, message in found if topic == "/replan"]
    assert {schema.name for schema, topic, _ in found if topic == "/scene"} == {"foxglove.SceneUpdate"}
    assert len(scenes) == len(places) == len(told) == len(run.records)
    first = {entity.id: entity for entity in scenes[0].entities}
    assert set(first) == {"plan", "ship", "vehicle", "wall 0"}
    assert all("wall 0" in {entity.id for entity in each.entities} for each in scenes), "for viewers that connect later"
    assert first["plan"].lines[0].points[-1].x == pytest.approx(8.0, abs=0.1)
    assert first["ship"].texts[0].text == "ship"
    assert first["vehicle"].frame_id == "base_link" and first["vehicle"].cylinders[0].size.x == pytest.approx(0.6)
    outline = first["ship"].lines[0].points
    zone = next(each for each in run.records[0].zones if each.id == "ship")
    for point in outline:
        assert float(zone.signed_distance(run.records[0].time, (point.x, point.y))) == pytest.approx(0.0, abs=1e-6)
    for place, record, line in zip(places, run.records, told, strict=True):
        assert (place.translation.x, place.translation.y) == pytest.approx(record.position)
        assert place.timestamp.seconds + 1e-9 * place.timestamp.nanos == pytest.approx(record.time + 1.7e9)
        assert line["outcome"] == record.outcome and len(line["candidates"]) == len(record.candidates) > 0


def test_a_recording_is_served_while_it_is_made(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    client = pytest.importorskip("websockets.sync.client")
    planner = sp.Planner(scene(disc("ship", (8.0, -3.0), (0.0, 0.8)), goal={"position": [8.0, 0.0]}))
    with planner.record(tmp_path / "drive.jsonl", live=True):
        with client.connect("ws://127.0.0.1:8765", subprotocols=["foxglove.sdk.v1"]) as socket:
            topics = set[str]()
            while topics != {"/scene", "/tf", "/replan"}:
                told = json.loads(socket.recv(timeout=10.0))
                topics |= {each["topic"] for each in told.get("channels", ())}
                numbers = [each["id"] for each in told.get("channels", ()) if each["topic"] == "/replan"]
                if numbers:
                    asked = [{"id": 1, "channelId": number} for number in numbers]
                    socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
            answer, time = b"", 0.0
            while b"outcome" not in answer and time < 5.0:  # until the server has heard what is subscribed to
                plan = planner.replan(time, (time, 0.0), 0.0, 1.0)
                time += 0.05
                with suppress(TimeoutError):
                    found = socket.recv(timeout=0.1)
                    answer = found if isinstance(found, bytes) else b""
    assert b'"outcome"' in answer and str(plan.code).encode() in answer


def test_walls_are_those_of_the_moment(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    planner = sp.Planner(scene(goal={"position": [8.0, 0.0]}))
    with planner.record(tmp_path / "drive.jsonl"):
        for number, walls in enumerate(([], [[[3.0, 2.0], [5.0, 2.0], [5.0, 3.0]]], [])):
            planner.set_walls(walls)
            planner.replan(0.1 * number, (0.1 * number, 0.0), 0.0, 1.0)
    save_scene(sp.Run.load(tmp_path / "drive.jsonl"), tmp_path / "drive.mcap")
    scenes = [
        decoded(schema, message.data) for schema, topic, message in read(tmp_path / "drive.mcap") if topic == "/scene"
    ]
    assert ["wall 0" in {entity.id for entity in each.entities} for each in scenes] == [False, True, False]
    assert [deleted.id for deleted in scenes[2].deletions] == ["wall 0"]
