"""What the sections share: rows of the CSV files, figures in one style."""

from __future__ import annotations

from benchmarks import common  # isort: skip

from collections.abc import Sequence
from pathlib import Path
from typing import Any

Row = dict[str, str]
COLORS = ("#0b6e99", "#d9730d", "#448361", "#9065b0", "#c14c8a", "#787774")


def value_of(row: Row, key: str) -> float:
    return float(row[key]) if row.get(key) not in (None, "") else float("nan")


def families_of(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row["family"] for row in rows))


def of_family(rows: Sequence[Row], family: str) -> list[Row]:
    return [row for row in rows if family in ("all", row["family"])]


def median_of(rows: Sequence[Row], key: str, level: float = 0.5) -> float:
    return common.quantile((value_of(row, key) for row in rows), level)


class Figures:
    """Draws into one folder, in one style, the same bytes for the same numbers."""

    def __init__(self, folder: Path) -> None:
        import matplotlib

        matplotlib.use("Agg")
        matplotlib.rcParams.update(
            {
                "svg.hashsalt": "scp_planner",
                "font.size": 9,
                "axes.spines.top": False,
                "axes.spines.right": False,
                "axes.grid": True,
                "axes.axisbelow": True,
                "grid.color": "#e3e2e0",
                "legend.frameon": False,
            }
        )
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def axes(self, width: float = 7.0, height: float = 3.2, count: int = 1) -> tuple[Any, Any]:
        """Return a figure and its axes (an array if more than one)."""
        import matplotlib.pyplot as plt

        return plt.subplots(1, count, figsize=(width, height), layout="constrained")

    def save(self, figure: Any, name: str, alternative: str) -> str:
        """Save as SVG; return the Markdown that shows it."""
        import matplotlib.pyplot as plt

        figure.savefig(self._folder / f"benchmarks-{name}.svg", metadata={"Date": None})
        plt.close(figure)
        return f"![{alternative}]({self._folder.name}/benchmarks-{name}.svg)"
