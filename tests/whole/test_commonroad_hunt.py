"""Files of CommonRoad that are changed at random."""

from __future__ import annotations

import random
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("commonroad", reason="needs commonroad-io, which is not installed")

from benchmarks.commonroad_hunt import CHANGES, changed

FILE = """<commonRoad timeStepSize="0.1"><dynamicObstacle id="1"><initialState><position><point><x>5</x><y>1</y></point>
</position></initialState><trajectory><state><position><point><x>7</x><y>2</y></point></position><time><exact>1</exact>
</time></state></trajectory></dynamicObstacle><planningProblem id="2"><initialState><position><point><x>0</x><y>0</y>
</point></position><orientation><exact>0.5</exact></orientation><velocity><exact>8</exact></velocity></initialState>
<goalState><time><intervalStart>1</intervalStart><intervalEnd>50</intervalEnd></time></goalState></planningProblem>
</commonRoad>"""


def test_a_seed_makes_the_same_file_again(tmp_path: Path) -> None:
    file = tmp_path / "one.xml"
    file.write_text(FILE, encoding="utf-8")
    folder = tmp_path / "changed"
    folder.mkdir()
    seen = set()
    for seed in range(40):
        path, names = changed(file, random.Random(seed), folder)
        once = path.read_bytes()
        changed(file, random.Random(seed), folder)
        assert path.read_bytes() == once
        assert ElementTree.fromstring(once).find("planningProblem") is not None
        seen.update(names.split(", "))
    assert seen == {change.__name__ for change in CHANGES}
    assert file.read_text(encoding="utf-8") == FILE
