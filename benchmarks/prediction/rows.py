"""Rows of predictions, and their table."""

from __future__ import annotations

from benchmarks import common, online  # isort: skip

from collections.abc import Sequence

from benchmarks.prediction import families, recordings
from benchmarks.prediction.measure import AFTER, SHOWN, predict_family, summarise

Row = online.Row
KEYS = ("family", "labelled", "level", "count", "seed")


def measure(row: Row) -> Row:
    """Predict one family at one level. Lengths in m, shares in %."""
    name, count, seed = row["family"], int(row["count"]), int(row["seed"])
    if name in recordings.PLACES:
        family = recordings.make(name, count, row["tracks_folder"] or None)
    else:
        family = families.make(name, count, seed)
    if row["labelled"] == "no":
        family = families.unlabelled(family)
    found = summarise(predict_family(family, row["level"], seed=seed), family.sensor.noise, row["level"])
    facts: Row = {"predictions": found.number, "tracks": found.tracks}
    for k, lead in enumerate(SHOWN):
        facts[f"held {lead}"] = round(100.0 * float(found.held[k]), 1)
        facts[f"radius {lead}"] = round(float(found.radius[k]), 3)
        facts[f"best {lead}"] = round(float(found.best[k]), 3)
    facts["tube"] = round(100.0 * found.tube, 1)
    facts["tube best"] = round(found.tube_best, 3)
    facts["ratio"] = round(found.ratio, 3)
    for k, after in enumerate(AFTER):
        facts[f"after {after}"] = round(100.0 * float(found.after[k]), 1)
    return facts


def table(rows: Sequence[Row]) -> str:
    """Table of rows, as they come."""
    headings = (
        "family",
        "label",
        "level",
        "held, %",
        "radius",
        "best",
        "tube, %",
        "best tube",
        "ratio",
        "after change, %",
    )
    found = []
    for row in rows:
        by_lead = {key: [float(row[f"{key} {lead}"]) for lead in SHOWN] for key in ("held", "radius", "best")}
        after = [float(row[f"after {each}"]) for each in AFTER]
        found.append(
            (
                row["family"],
                row["labelled"],
                row["level"],
                " ".join(common.number(each, 0) for each in by_lead["held"]),
                " ".join(common.number(each, 2) for each in by_lead["radius"]),
                " ".join(common.number(each, 2) for each in by_lead["best"]),
                common.number(float(row["tube"]), 1),
                common.number(float(row["tube best"]), 2),
                common.number(float(row["ratio"]), 2),
                " ".join(common.number(each, 0) for each in after),
            )
        )
    return common.table(headings, found)
