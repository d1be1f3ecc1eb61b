"""Benchmarks: this engine, the parts of its time, and peers beside it."""
