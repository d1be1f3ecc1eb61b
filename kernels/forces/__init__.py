"""Forces between collisions.

================  =======================================
`force_events`    forces that act within a window
`forces`          forces that act at a window's beginning
`table_friction`  a disk that slides and spins on a table
================  =======================================
"""
