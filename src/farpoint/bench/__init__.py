"""Tables of accuracy, coverage and time, for farpoint and installed peer libraries.

`farpoint.bench.run.run_bench` makes the tables that `farpoint.bench.options.BenchOptions` select.
"""
