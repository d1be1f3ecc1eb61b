"""validation.gas."""
