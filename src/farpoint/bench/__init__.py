"""Tables of accuracy, coverage and time, against the peers that are installed.

`farpoint.bench.run.run_bench` makes them, as `farpoint.bench.options.BenchOptions` says.
"""
