"""The notebooks of the documentation run, are stored without outputs, and keep what they claim."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
NOTEBOOKS = sorted(TUTORIALS.glob("*.ipynb"))

pytestmark = pytest.mark.filterwarnings("default")  # of Jupyter's own machinery


def executed(notebook: Any, folder: Path) -> str:
    """What the cells of a notebook print and show as text."""
    client = NotebookClient(
        notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    )
    outputs = [output for cell in client.execute().cells for output in cell.get("outputs", [])]
    shown = (output.get("text") or output.get("data", {}).get("text/plain") for output in outputs)
    return "\n".join(text for text in shown if text)


def named(name: str) -> Any:
    return nbformat.read(TUTORIALS / f"{name}.ipynb", as_version=4)


def number_after(words: str, text: str) -> float:
    found = re.search(re.escape(words) + r"\s*(-?[\d.]+)", text)
    assert found, f"{words!r} is not in\n{text}"
    return float(found[1])


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(path: Path):
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None


def test_own_matches_are_solved_and_a_rotation_is_recognised(tmp_path: Path):
    text = executed(named("own_matches"), tmp_path)
    assert re.search(r"^OK - ", text, re.M)
    assert re.search(r"^ROTATION_ONLY - ", text, re.M)
    assert "direction: None" in text
    assert 0.0 < number_after("NEES:", text) < 20.0  # chi-square with 5 degrees of freedom


def test_the_speed_becomes_known_by_camera_and_imu(tmp_path: Path):
    text = executed(named("imu"), tmp_path)
    alone, both = re.findall(r"speed +([\d.]+) m/s", text)
    assert float(both) < 0.05 < float(alone)
    assert number_after("IMU and camera  attitude", text) < 0.5


def test_a_cell_that_fails_is_noticed(tmp_path: Path):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("1 / 0")])
    with pytest.raises(CellExecutionError, match="ZeroDivisionError"):
        executed(notebook, tmp_path)
