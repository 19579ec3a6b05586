"""The parts of `benchmarks/simulator.py`."""
