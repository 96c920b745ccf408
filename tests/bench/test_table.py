from __future__ import annotations

import csv
import io

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
