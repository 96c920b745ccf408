"""Tables of accuracy, coverage and time, against the peers that are installed."""

from farpoint.bench.options import TABLES, BenchOptions, CoverageGrid, Progress, TableName
from farpoint.bench.run import BenchReport, run_bench
from farpoint.bench.table import Column, Table

__all__ = [
    "TABLES",
    "BenchOptions",
    "BenchReport",
    "Column",
    "CoverageGrid",
    "Progress",
    "Table",
    "TableName",
    "run_bench",
]
