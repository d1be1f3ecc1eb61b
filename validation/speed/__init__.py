"""validation.speed."""
