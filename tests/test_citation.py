"""``CITATION.cff`` and the package's metadata say the same."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import yaml

import farpoint

CITATION = yaml.safe_load((Path(__file__).parents[1] / "CITATION.cff").read_text())


def test_the_citation_is_of_this_version_and_names_the_paper():
    assert CITATION["cff-version"] == "1.2.0"
    assert CITATION["version"] == farpoint.__version__
    assert CITATION["license"] == "MIT"
    (paper,) = CITATION["references"]
    assert paper["doi"] == "10.1007/978-3-540-78157-8_34"
    assert [author["family-names"] for author in paper["authors"]] == ["Burschka", "Mair"]


def test_the_package_names_its_places_on_the_web():
    places = dict(
        entry.split(", ", 1)
        for entry in importlib.metadata.metadata("farpoint").get_all("Project-URL") or ()
    )
    assert places["Repository"] == CITATION["repository-code"]
    assert {"Documentation", "Issues", "Changelog"} <= set(places)
