"""Benchmarks: this engine, the parts of its time, and other codes."""
