"""Validation cases: their list, their run, the report."""
