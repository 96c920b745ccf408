from __future__ import annotations

import csv
import io
import json

import numpy as np

from farpoint.bench.table import Column, Table

TABLE = Table(
    name="fruit",
    title="Fruit",
    command="farpoint bench --tables fruit",
    columns=(Column("name"), Column("count"), Column("weight_kg", 2)),
    rows=(("apple", 12, 1.23456789), ("pear, green", 3, float("nan")), ("plum", None, 0.5)),
    notes=("weighed " + 30 * "very " + "carefully",),
)


def test_text_is_aligned_with_words_left_and_numbers_right():
    lines = TABLE.to_text().splitlines()
    assert lines[:8] == [
        "Fruit",
        "$ farpoint bench --tables fruit",
        "",
        "name         count  weight_kg",
        "-----------  -----  ---------",
        "apple           12       1.23",
        "pear, green      3",
        "plum                     0.50",
    ]
    assert lines[8] == ""
    assert lines[9].startswith("- weighed very")
    assert all(len(line) <= 100 for line in lines)


def test_csv_reads_back_with_six_digits_and_empty_fields():
    rows = list(csv.DictReader(io.StringIO(TABLE.to_csv())))
    assert rows == [
        {"name": "apple", "count": "12", "weight_kg": "1.23457"},
        {"name": "pear, green", "count": "3", "weight_kg": ""},
        {"name": "plum", "count": "", "weight_kg": "0.5"},
    ]


def test_json_reads_back_with_six_digits_and_null_for_what_does_not_exist():
    found = json.loads(TABLE.to_json(date="2026-11-28", environment="a machine"))
    assert found == {
        "date": "2026-11-28",
        "environment": "a machine",
        "name": "fruit",
        "title": "Fruit",
        "command": "farpoint bench --tables fruit",
        "columns": [
            {"name": "name", "decimals": 0},
            {"name": "count", "decimals": 0},
            {"name": "weight_kg", "decimals": 2},
        ],
        "rows": [["apple", 12, 1.23457], ["pear, green", 3, None], ["plum", None, 0.5]],
        "notes": list(TABLE.notes),
    }


def test_json_has_numbers_of_numpy_and_the_word_for_infinite_ones():
    columns = (Column("count"), Column("ratio", 2))
    rows = ((np.int64(3), float("inf")), (0, np.float64(0.25)))
    table = Table(name="t", title="", command="", columns=columns, rows=rows)  # type: ignore
    assert json.loads(table.to_json())["rows"] == [[3, "inf"], [0, 0.25]]


def test_json_has_a_row_on_each_line():
    lines = TABLE.to_json().splitlines()
    assert '  ["apple", 12, 1.23457],' in lines
