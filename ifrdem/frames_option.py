"""The option --frames of verbs that read trajectories."""

from __future__ import annotations

from .errors import InputError


def chosen(text: str | None, count: int, path: object) -> list[int] | None:
    """Frames by a text such as "5", "-1", "10:", "::10", as Python's slices; None without a text.

    Raises
    ------
    InputError
        If it is not of this form, or no frame of the `count` in the file is meant.
    """
    if text is None:
        return None
    form = f"--frames {text}: a frame (5, -1) or a range as in Python (10:, 5:50:5, ::10) is needed"
    parts = text.split(":")
    try:
        numbers = [int(part) if part.strip() else None for part in parts]
    except ValueError:
        raise InputError(form) from None
    if len(parts) == 1 and numbers[0] is not None:
        if not -count <= numbers[0] < count:
            raise InputError(f"--frames {text}: {path} has {count} frames, 0 to {count - 1}")
        return [numbers[0] % count]
    if len(parts) > 3 or len(parts) == 1 or (len(parts) == 3 and numbers[2] is not None and numbers[2] <= 0):
        raise InputError(form)
    found = list(range(count)[slice(*numbers)])
    if not found:
        raise InputError(f"--frames {text}: none of the {count} frames of {path}")
    return found
