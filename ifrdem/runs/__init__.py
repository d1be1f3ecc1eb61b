"""One run of a case: its outputs, progress, status, signals, and how it is resumed."""
