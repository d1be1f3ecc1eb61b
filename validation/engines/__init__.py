"""Validation against PyBullet and pymunk."""
