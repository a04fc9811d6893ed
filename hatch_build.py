"""What is read of the package's page elsewhere: the README without links that lead only in the repository."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PICTURE = re.compile(r"^!\[[^\]]*\]\((?!https?:)[^)]*\)\n\n?", re.MULTILINE)
LINK = re.compile(r"(?<!!)\[([^\]]*)\]\((?!https?:|#)([^)]*)\)")
COMMENT = re.compile(r"^<!--.*?-->\n", re.MULTILINE | re.DOTALL)
SOURCE = "Source"
"""The key of `[project.urls]` of where the files of the repository can be read, if there is such a place."""


def page_of(readme: str, source: str | None) -> str:
    """Return a README whose links work anywhere.

    Parameters
    ----------
    readme : str
    source : str or None
        Where links into the repository begin; None: they become plain text, and pictures are left out.

    Returns
    -------
    str
    """
    text = COMMENT.sub("", readme)
    if source is None:
        return LINK.sub(lambda found: found[1], PICTURE.sub("", text))
    begin = source.rstrip("/") + "/"
    text = re.sub(r"(!\[[^\]]*\]\()(?!https?:)([^)]*\))", lambda found: found[1] + begin + found[2], text)
    return LINK.sub(lambda found: f"[{found[1]}]({begin}{found[2]})", text)


class ReadmeHook(MetadataHookInterface):
    """Gives the README of the metadata."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Fill in what `pyproject.toml` leaves open."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        page = page_of(text, metadata.get("urls", {}).get(SOURCE))
        metadata["readme"] = {"content-type": "text/markdown", "text": page}
