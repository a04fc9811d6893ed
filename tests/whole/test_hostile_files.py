"""Damaged files of each kind: readers, and what uses what they read, raise the documented errors alone."""

from __future__ import annotations

import pytest

from benchmarks.hostile import files


@pytest.mark.parametrize("kind", files.KINDS)
def test_damaged_files_are_refused_or_used(kind: str) -> None:
    results = list(files.hunt(kind, 50, seed=10**6))
    assert len(results) == 50 and any(result == "refused" for _, result, _ in results)
    assert not [detail for _, _, detail in results if detail]
