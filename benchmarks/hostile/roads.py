"""A small CommonRoad file: a straight lane, a car that drives ahead, and a goal."""


def _points(y: float) -> str:
    return "".join(f"<point><x>{x}.0</x><y>{y}</y></point>" for x in (-20, 20, 60, 100))


def _state(step: int, x: float, tag: str = "state") -> str:
    return (
        f"<{tag}><position><point><x>{x}</x><y>0.0</y></point></position><orientation><exact>0.0</exact></orientation>"
        f"<time><exact>{step}</exact></time><velocity><exact>8.0</exact></velocity></{tag}>"
    )


ROAD = f"""<?xml version="1.0" encoding="UTF-8"?>
<commonRoad timeStepSize="0.1" commonRoadVersion="2020a" author="a" affiliation="b" source="c"
 benchmarkID="ZAM_Test-1_1_T-1" date="2020-01-01">
<location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude><gpsLongitude>999</gpsLongitude></location>
<scenarioTags/>
<lanelet id="1"><leftBound>{_points(2.0)}</leftBound><rightBound>{_points(-2.0)}</rightBound></lanelet>
<dynamicObstacle id="2"><type>car</type><shape>
<rectangle><length>4.0</length><width>1.8</width></rectangle></shape>
{_state(0, 40.0, "initialState")}<trajectory>{"".join(_state(k, 40.0 + 0.8 * k) for k in range(1, 30))}</trajectory>
</dynamicObstacle>
<planningProblem id="3"><initialState>
<position><point><x>0.0</x><y>0.0</y></point></position><velocity><exact>8.0</exact></velocity>
<orientation><exact>0.0</exact></orientation><yawRate><exact>0.0</exact></yawRate>
<slipAngle><exact>0.0</exact></slipAngle><time><exact>0</exact></time></initialState>
<goalState><time><intervalStart>20</intervalStart><intervalEnd>40</intervalEnd></time>
<position><rectangle><length>8.0</length><width>3.0</width><orientation>0.0</orientation>
<center><x>24.0</x><y>0.0</y></center></rectangle></position></goalState></planningProblem>
</commonRoad>
"""
