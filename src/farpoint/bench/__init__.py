"""Tables of accuracy, coverage and time, for farpoint and the peers that are installed.

`farpoint.bench.run.run_bench` makes them, by `farpoint.bench.options.BenchOptions`.
"""
