"""validation.engines."""
