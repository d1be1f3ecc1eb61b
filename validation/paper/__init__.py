"""validation.paper."""
