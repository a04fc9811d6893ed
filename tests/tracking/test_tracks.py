from __future__ import annotations

import os
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from scp_planner.errors import EstimationError, ScenarioError, TracksError
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.tracking.estimate import estimate_obstacle
from scp_planner.tracking.tracks import Track, Tracks

OBSMAT = """\
   1.0000000e+01   1.0000000e+00   0.0   0.0   5.0   1.2   0.0   0.0
   1.6000000e+01   1.0000000e+00   0.5   0.0   5.1   1.2   0.0   0.0
   1.6000000e+01   2.0000000e+00   9.0   0.0   1.0   0.0   0.0   0.0
   2.2000000e+01   1.0000000e+00   1.0   0.0   5.2   1.2   0.0   0.0
   3.4000000e+01   1.0000000e+00   2.0   0.0   5.4   1.2   0.0   0.0
"""


def write(folder: Path, text: str, name: str = "tracks.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


class TestFiles:
    def test_csv_in_any_order_with_other_columns(self, tmp_path: Path) -> None:
        text = 'x,note,time,y,id\n1,hello,0.5,2,b\n5,,1.0,6,a\n3,"a, b",0.0,4,b\n\n'
        tracks = Tracks.load(write(tmp_path, text))
        assert tracks.ids == ("b", "a")
        assert tracks[0].times.tolist() == [0.0, 0.5]
        assert tracks[0].positions.tolist() == [[3.0, 4.0], [1.0, 2.0]]
        assert (tracks.start, tracks.stop, tracks.observations) == (0.0, 1.0, 3)

    def test_csv_of_other_programs(self, tmp_path: Path) -> None:
        """Units in the names, spaces, semicolons, and what spreadsheets put before and behind lines."""
        for header in ("id,time_s,x_m,y_m", "ID; t [s]; x [m]; y [m]"):
            rows = [header, "a,0,1,2", "a,0.5,1.5,2"]
            text = "\r\n".join(row.replace(",", ";") if ";" in header else row for row in rows)
            (tmp_path / "tracks.csv").write_bytes(text.encode("utf-8-sig"))
            (track,) = Tracks.load(tmp_path / "tracks.csv")
            assert (track.times.tolist(), track.positions.tolist()) == ([0.0, 0.5], [[1.0, 2.0], [1.5, 2.0]])

    def test_saved_tracks_keep_every_bit(self, tmp_path: Path) -> None:
        rng = np.random.default_rng(1)
        tracks = Tracks(
            [Track(name, np.sort(rng.random(4)), rng.normal(size=(4, 2))) for name in ("1", 'a "b", c', "é")]
        )
        tracks.save(tmp_path / "copy.csv")
        for one, other in zip(tracks, Tracks.load(tmp_path / "copy.csv"), strict=True):
            assert one.id == other.id
            assert one.times.tolist() == other.times.tolist()
            assert one.positions.tolist() == other.positions.tolist()

    @pytest.mark.parametrize("step", [6, 10])
    def test_obsmat_has_rows_of_a_person_0_4_s_apart(self, tmp_path: Path, step: int) -> None:
        text = OBSMAT
        if step == 10:
            for old, new in (
                ("1.0000000e+01 ", "1.0e+01 "),
                ("1.6000000e+01", "2.0e+01"),
                ("2.2000000e+01", "3.0e+01"),
            ):
                text = text.replace(old, new)
            text = text.replace("3.4000000e+01", "5.0e+01")
        tracks = Tracks.load(write(tmp_path, text, "crowd_obsmat.txt"))
        assert tracks.ids == ("1", "2")
        assert np.diff(tracks[0].times) == pytest.approx([0.4, 0.4, 0.8])  # one row is missing
        assert tracks[0].positions[1].tolist() == [0.5, 5.1]
        assert tracks.of("2").times[0] == pytest.approx(tracks.of("1").times[1])

    def test_drone_recordings(self, tmp_path: Path) -> None:
        text = "id,frame,label,x_est,y_est,vx_est,vy_est\n0,24,ped,1,2,0,0\n0,25,ped,3,4,0,0\n"
        (track,) = Tracks.load(write(tmp_path, text))
        assert track.times == pytest.approx([24 / 23.98, 25 / 23.98])

    def test_single_cyclists(self, tmp_path: Path) -> None:
        (track,) = Tracks.load(write(tmp_path, ",timestamp,x,y\n0,0.0,1,2\n1,0.08,3,4\n", "17.csv"))
        assert (track.id, track.times.tolist()) == ("17", [0.0, 0.08])

    def test_folders_with_folders(self, tmp_path: Path) -> None:
        (tmp_path / "in").mkdir()
        write(tmp_path, OBSMAT, "a_obsmat.txt")
        write(tmp_path / "in", ",timestamp,x,y\n0,0.0,1,2\n", "17.csv")
        write(tmp_path, "not for us", "notes.md")
        assert Tracks.load(tmp_path).ids == ("a_obsmat/1", "a_obsmat/2", "in/17")

    @pytest.mark.parametrize(
        ("text", "faults"),
        [
            ("", ["it is empty"]),
            ("id,time,x,y\n", ["must have rows"]),
            (
                "who,when,x,y\n1,2,3,4\n",
                ["line 1 = 'who,when,x,y': must be a header with the columns id, time, x and y"],
            ),
            (
                "id,time,x,y\na,0,1,north\nb,nan,1,2\n\nc,1,2\n,3,1,2\n",
                [
                    "line 2, column y = 'north': must be a finite number",
                    "line 3, column time = 'nan': must be a finite number",
                    "line 5, column y: must be a finite number",
                    "line 6, column id = '': must name the track",
                ],
            ),
            ("id,time,x,y\na,0,1,2\na,0,1,3\n", ["line 3, column time = 0.0: must not be there twice for track a"]),
            (OBSMAT.replace("5.1", "inf"), ["line 2, column y = 'inf'"]),
            ("1 1 0 0 0 0 0 0\n", ["persons with more than one row"]),
            ("1 1 0 0 0 0 0 0\n2 1 0\n", ["line 2, column y"]),
        ],
    )
    def test_faults_name_file_line_and_column(self, tmp_path: Path, text: str, faults: list[str]) -> None:
        path = write(tmp_path, text)
        with pytest.raises(TracksError) as caught:
            Tracks.load(path)
        for fault in (str(path), *faults):
            assert fault in str(caught.value)

    def test_a_file_of_faults_does_not_drown_the_reader(self, tmp_path: Path) -> None:
        with pytest.raises(TracksError) as caught:
            Tracks.load(write(tmp_path, "id,time,x,y\n" + "a,b,c,d\n" * 1000))
        assert 20 <= len(caught.value.faults) < 25

    def test_xml_of_commonroad_has_the_trajectories_of_its_obstacles(self, tmp_path: Path) -> None:
        state = "<{0}><position><point><x>{1}</x><y>{2}</y></point></position><time><exact>{3}</exact></time></{0}>"
        moving = state.format("initialState", 1.0, 2.0, 0) + "<trajectory>"
        moving += state.format("state", 1.5, 2.0, 1) + state.format("state", 2.5, 2.25, 2) + "</trajectory>"
        standing = state.format("initialState", 9.0, 9.0, 0)
        text = f"<dynamicObstacle id='7'>{moving}</dynamicObstacle><dynamicObstacle id='8'>{standing}</dynamicObstacle>"
        path = write(tmp_path, f"<commonRoad timeStepSize='0.1'>{text}</commonRoad>", "cut.xml")
        (track,) = Tracks.load(path)
        assert track.id == "7"
        np.testing.assert_allclose(track.times, [0.0, 0.1, 0.2])
        np.testing.assert_array_equal(track.positions, [[1.0, 2.0], [1.5, 2.0], [2.5, 2.25]])
        other = write(tmp_path, "id,time,x,y\na,0,1,2\n", "more.csv")
        assert Tracks.joined([path, other]).ids == ("cut/7", "more/a")
        assert Tracks.joined([path]).ids == ("7",)

    @pytest.mark.parametrize(
        ("text", "fault"),
        [
            ("<commonRoad", "not a CommonRoad file"),
            ("<commonRoad/>", "timeStepSize = null: must be a positive number"),
            ("<commonRoad timeStepSize='0.1'/>", "must hold obstacles with trajectories"),
            (
                "<c timeStepSize='1'><obstacle id='3'><initialState/><trajectory><state/></trajectory></obstacle></c>",
                "obstacle 3, state 1",
            ),
        ],
    )
    def test_bad_xml_is_refused(self, tmp_path: Path, text: str, fault: str) -> None:
        with pytest.raises(TracksError) as caught:
            Tracks.load(write(tmp_path, text, "cut.xml"))
        assert fault in str(caught.value)

    def test_other_bad_files(self, tmp_path: Path) -> None:
        (tmp_path / "raw.csv").write_bytes(b"id,time,x,y\n\xff\xfe")
        with pytest.raises(TracksError, match="must be UTF-8"):
            Tracks.load(tmp_path / "raw.csv")
        with pytest.raises(FileNotFoundError):
            Tracks.load(tmp_path / "none.csv")
        (tmp_path / "empty").mkdir()
        with pytest.raises(TracksError, match=r"must hold files ending in .csv or .txt"):
            Tracks.load(tmp_path / "empty")


class TestTracks:
    tracks = Tracks([Track(str(i), np.arange(5.0) + i, np.full((5, 2), float(i))) for i in range(5)])

    def test_halves_are_every_other_track(self) -> None:
        first, second = self.tracks.halves()
        assert (first.ids, second.ids) == (("0", "2", "4"), ("1", "3"))

    def test_stretch_of_time(self) -> None:
        track = self.tracks.of("2")
        cut = track.between(3.0, 4.5)
        assert cut is not None
        assert cut.times.tolist() == [3.0, 4.0]
        assert track.between(3.1, 3.9) is None

    @pytest.mark.parametrize(
        ("times", "positions", "message"),
        [
            ([0, 1], [[0, 0]], "shapes"),
            ([], np.zeros((0, 2)), "shapes"),
            ([1, 0], [[0, 0], [1, 1]], "do not increase"),
            ([0, np.nan], [[0, 0], [1, 1]], "not finite"),
        ],
    )
    def test_faulty_tracks_are_named(self, times: list[float], positions: list[list[float]], message: str) -> None:
        with pytest.raises(EstimationError, match=f"track 'x': .*{message}"):
            Track("x", times, positions)  # type: ignore[arg-type]

    def test_ids_are_unique(self) -> None:
        with pytest.raises(EstimationError, match="'0' is there twice"):
            Tracks([self.tracks[0], self.tracks[0]])
        with pytest.raises(EstimationError, match="none with the id '9'"):
            self.tracks.of("9")


class TestScenario:
    trip: ClassVar[dict[str, Any]] = {
        "start": {"position": [0, 0], "heading": 0.0, "speed": 1.0},
        "goal": {"position": [20, 0]},
        "vehicle": {"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.0, "max_deceleration": 1.0},
    }

    def tracks(self) -> Tracks:
        rng = np.random.default_rng(2)

        def walker(name: str, first: float, last: float) -> Track:
            times = np.arange(first, last, 0.4)
            return Track(
                name, times, np.stack([times, 5.0 + 0.0 * times], axis=1) + 0.02 * rng.normal(size=(len(times), 2))
            )

        return Tracks(
            [
                walker("long", 0.0, 20.0),
                walker("gone", 0.0, 6.0),
                walker("new", 9.5, 20.0),
                walker("later", 11.0, 20.0),
            ],
            "crowd_obsmat.txt",
        )

    def test_holds_what_had_been_seen(self) -> None:
        scenario = self.tracks().scenario_at(10.0, **self.trip, window=3.0)
        assert scenario.name == "crowd_obsmat at 10 s"
        assert scenario.start.time == 10.0
        assert [o.id for o in scenario.obstacles] == ["long", "new"]
        long, new = scenario.obstacles
        assert long.observations is not None and new.observations is not None
        assert min(long.observations.time) >= 7.0
        assert max(long.observations.time) <= 10.0
        assert len(long.observations.time) == 8
        assert (long.model.order, new.model.order) == (1, 1)
        assert long.observations.covariance == ((0.05**2, 0.0), (0.0, 0.05**2))
        assert len(new.observations.time) == 2

    def test_obstacles_seen_too_rarely_get_a_lower_order(self) -> None:
        scenario = self.tracks().scenario_at(9.6, **self.trip, order=2)
        assert {o.id: o.model.order for o in scenario.obstacles} == {"long": 2, "new": 0}
        for obstacle in scenario.obstacles:
            estimate_obstacle(obstacle)

    def test_noise_can_be_estimated_if_there_are_enough(self) -> None:
        scenario = self.tracks().scenario_at(9.0, **self.trip, noise=None, order=2)
        (long,) = scenario.obstacles
        assert long.observations is not None
        assert long.observations.covariance is None
        estimate_obstacle(long)
        with pytest.raises(EstimationError, match="track 'new': 2 positions are too few"):
            self.tracks().scenario_at(10.0, **self.trip, noise=None)

    def test_motion_with_process_noise(self) -> None:
        process = ProcessModel(
            process={"kind": "random_walk", "diffusion": 0.1}, velocity_deviation=1.0, noise_deviation=0.05
        )
        scenario = self.tracks().scenario_at(9.6, **self.trip, process=process, noise=None, radius=0.4)
        assert {o.id for o in scenario.obstacles} == {"long", "new"}
        for obstacle in scenario.obstacles:
            assert obstacle.model.process == process
            assert estimate_obstacle(obstacle).noise_covariance == pytest.approx(0.05**2 * np.eye(2))

    def test_other_fields_are_the_scenarios(self) -> None:
        scenario = self.tracks().scenario_at(
            10.0, **self.trip, name="hall", confidence={"probability": 0.9, "level": "per_time"}
        )
        assert (scenario.name, scenario.confidence.probability) == ("hall", 0.9)
        with pytest.raises(ScenarioError, match=r"vehicle\.radius"):
            self.tracks().scenario_at(10.0, **{**self.trip, "vehicle": {**self.trip["vehicle"], "radius": -1}})


class TestRecorded:
    @pytest.mark.parametrize(("name", "people", "step"), [("eth", 360, 6), ("hotel", 390, 10), ("univ", 428, 10)])
    def test_pedestrians(self, recorded_data: Path, name: str, people: int, step: int) -> None:
        path = recorded_data / "pedestrians" / f"{name}_obsmat.txt"
        tracks = Tracks.load(path)
        assert len(tracks) == people
        rows = np.loadtxt(path)
        assert tracks.observations == len(rows)
        first = rows[rows[:, 1] == int(tracks[0].id)]
        assert tracks[0].times == pytest.approx(first[:, 0] * 0.4 / step)
        assert tracks[0].positions == pytest.approx(first[:, [2, 4]])
        # the file's own velocities, of smoothed splines, are in m/s: the clock is right
        measured = np.linalg.norm(np.diff(tracks[0].positions, axis=0), axis=1) / np.diff(tracks[0].times)
        assert np.median(measured) == pytest.approx(np.median(np.hypot(first[:, 5], first[:, 7])), rel=0.2)

    def test_cars_and_cyclists(self, recorded_data: Path) -> None:
        mixed = Tracks.load(recorded_data / "mixed_traffic")
        assert any("veh" in name for name in mixed.ids) and any("ped" in name for name in mixed.ids)
        cyclists = Tracks.load(recorded_data / "cyclists")
        assert len(cyclists) == sum(len(files) for _, _, files in os.walk(recorded_data / "cyclists"))
        assert all(0.05 < np.median(np.diff(track.times)) < 0.15 for track in cyclists)

    def test_scenario_of_a_crowd(self, recorded_data: Path) -> None:
        tracks = Tracks.load(recorded_data / "pedestrians" / "eth_obsmat.txt")
        scenario = tracks.scenario_at(700.0, **TestScenario.trip)
        present = [t.id for t in tracks if t.between(699.0, 700.0) is not None]
        assert sorted(o.id for o in scenario.obstacles) == sorted(present)
        assert len(present) > 10
