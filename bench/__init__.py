"""Measurements of speed, outside the tests: `python -m bench.NAME`."""
