"""Benchmarks of speed and memory, for asv and for ``python -m benchmarks``."""
