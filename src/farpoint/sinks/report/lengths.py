"""Unit of the lengths of a run, for the text of the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["FIRST_STEP", "METRE", "LengthUnit", "length_unit"]


@dataclass(frozen=True, kw_only=True)
class LengthUnit:
    """A unit of length.

    Attributes
    ----------
    singular, plural : str
        Name of the unit after a number.
    name : str
        Name of the unit beside a chart.
    meaning : str
        Explanation for readers; empty for metres.
    """

    singular: str
    plural: str
    name: str
    meaning: str

    def after(self, number: str) -> str:
        """The number with its unit."""
        return f"{number} {self.singular if number == '1' else self.plural}"


FIRST_STEP = LengthUnit(
    singular="unit",
    plural="units",
    name="unit of the trajectory",
    meaning="a unit is the first step",
)
METRE = LengthUnit(singular="m", plural="m", name="m", meaning="")


def length_unit(run: Mapping[str, Any]) -> LengthUnit:
    """The unit of the files of a run: metres if aiding measurements were given."""
    return METRE if run.get("metric", {}).get("unit") == "m" else FIRST_STEP
