"""The tiny study and its results, tracked once for all tests."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tiny_study import CELLS, run_quietly, tasks_of, write_study


@pytest.fixture(scope="session")
def study(tmp_path_factory) -> Path:
    """Twelve cells of three frames."""
    return write_study(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="session")
def whole(study, tmp_path_factory) -> Path:
    """The results of a run that nothing happened to."""
    folder = tmp_path_factory.mktemp("whole")
    status = run_quietly(tasks_of(study, folder))
    assert (status.finished, status.failures) == (CELLS, {})
    return folder


@pytest.fixture
def copied(whole, tmp_path) -> Path:
    """These results in a folder of one's own."""
    return Path(shutil.copytree(whole, tmp_path / "copied"))
