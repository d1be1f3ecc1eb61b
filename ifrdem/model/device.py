"""The device of a simulation: a CPU or a GPU, its threads and its precision."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from ..tools.checked import Choice, Count, Number, must_be, validated
from .overlaps import COMPUTED

NAMES = ("cpu", "cuda")


@validated
@dataclass(frozen=True)
class Device:
    """Where and in which precision a simulation is computed.

    Parameters
    ----------
    name : {"cpu", "cuda"}
        The CPU, or an NVIDIA GPU; a device that is not there is refused when a simulation is made.
    threads : int, optional
        Threads on the CPU, all cores by default. The trajectory is the same to the last bit for any number.
    precision : {"f64", "f32"}
        Double precision, or single: half the memory, and errors of 1e-7 instead of 1e-16 a step.
    window_collisions : float, optional
        Mean collisions of a disk in a window of the engine, 0.001 to 10; by default what is fastest on the device.
        Windows decide the last bits: with the same number, a CPU and a GPU give the same (`ifrdem docs exactness`).
    low_memory : bool
        Do not store the state at a time within a window: 30 % less memory, bitwise identical results. A stop within a
        window (a frame, a row of a series) then costs up to one window more. Without effect on gases of up to 20,000
        disks. Cannot be combined with walls, forces, shear, `ContactTime` or `Rest`.

    Raises
    ------
    InputError
        If a value is not one of these.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.Device("cpu", threads=2).precision
    'f64'
    """

    name: Literal["cpu", "cuda"] = "cpu"
    threads: Count | None = field(default=None, kw_only=True)
    precision: Literal["f64", "f32"] = field(default="f64", kw_only=True)
    window_collisions: Annotated[float, Number(1e-3, 10.0, "a number from 0.001 to 10")] | None = field(
        default=None, kw_only=True
    )
    low_memory: bool = field(default=False, kw_only=True)

    @property
    def rounding(self) -> float:
        """Rounding of the positions that it computes, for `overlaps.tolerances`."""
        return COMPUTED if self.precision == "f32" else 0.0

    @classmethod
    def of(cls, device: Any) -> Device:
        """A device as users give it: a `Device`, its name, or None for the default."""
        if device is None or isinstance(device, Device):
            return device or cls()
        if isinstance(device, str):
            return cls(Choice(NAMES)("device", device))
        raise must_be("device", device, 'a Device, or its name, "cpu" or "cuda"')
