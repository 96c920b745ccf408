from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from farpoint.bench.options import BenchOptions, CoverageGrid
from farpoint.errors import InputError


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("tables", {"tables": ()}),
        ("tables", {"tables": ("paper", "speed")}),
        ("pairs", {"pairs": 0}),
        ("seed", {"seed": -1}),
        ("full", {"full": True, "grid": CoverageGrid(trials=5)}),
    ],
)
def test_faults_name_the_option(field: str, change: dict):
    with pytest.raises(InputError) as caught:
        BenchOptions(**change)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("baselines_m", (-0.1,)),
        ("far_shares", (1.1,)),
        ("noises_px", (float("nan"),)),
        ("outlier_shares", ()),
        ("matches", (0,)),
        ("trials", 0),
    ],
)
def test_faults_name_the_part_of_the_grid(field: str, value: object):
    with pytest.raises(InputError) as caught:
        CoverageGrid(**{field: value})  # pyright: ignore[reportArgumentType]
    assert caught.value.field == field


def test_the_command_says_what_differs():
    options = BenchOptions(
        pairs=5,
        seed=3,
        data=(Path("my data"),),
        grid=CoverageGrid(trials=7, baselines_m=(0.0, 0.1)),
    )
    assert options.command("paper") == "farpoint bench --tables paper --pairs 5 --seed 3"
    assert options.command("pairs").endswith("--seed 3 --data 'my data'")
    assert options.command("coverage").endswith("--grid.baselines-m 0.0 0.1 --grid.trials 7")
    assert BenchOptions(full=True).command("coverage").endswith("--seed 0 --full")


def test_the_whole_grid_holds_the_small_one():
    small, whole = CoverageGrid(), CoverageGrid.whole()
    for field in fields(CoverageGrid):
        if field.name != "trials":
            assert set(getattr(small, field.name)) <= set(getattr(whole, field.name))
