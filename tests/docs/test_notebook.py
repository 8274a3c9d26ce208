"""The notebook of the documentation, executed as Jupyter does."""

import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.extras

NOTEBOOK = Path(__file__).parents[2] / "docs" / "notebooks" / "estimate.ipynb"


def test_the_notebook_runs_and_shows_tables_figures_and_a_link(tmp_path):
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    pytest.importorskip("pandas")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    # Everything is reachable by one import.
    imports = re.findall(r"^(?:import|from) (\w+)", "\n".join(cell.source for cell in notebook.cells), re.MULTILINE)
    assert {*imports} <= {"multicontact", "pathlib"}
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    shown = [{kind for out in each for kind in out.get("data", {})} for each in outputs]
    assert all("text/html" in shown[k] for k in (0, 1, 2, 5)) and all("image/png" in shown[k] for k in (3, 4))
    # One picture for each cell: figures are shown once.
    assert all(len(outputs[k]) == 1 for k in (3, 4))
    html = outputs[5][-1]["data"]["text/html"]
    assert '<a href="arm/report.html"' in html and (tmp_path / "arm" / "report.html").is_file()
