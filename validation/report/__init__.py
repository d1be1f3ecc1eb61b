"""validation.report."""
