"""Every public function and class has an example in its docstring, which prints the stated output."""

from __future__ import annotations

import doctest
import inspect
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import ifrdem
from ifrdem import analysis, bullet, fit, forces, initial, observables, plots, theory
from ifrdem.initial import radii

FACES: list[ModuleType] = [ifrdem, initial, radii, forces, observables, theory, analysis, fit, bullet, plots]

MADE_BY_FUNCTIONS = {
    "BinAverages", "Local", "MeanStress", "Measure", "Stress",
    "MixtureTemperatures", "Prediction", "ShearModes", "CoolingRatio", "Clusters", "ContactValue",
    "Correlation", "Diffusion", "Fields", "HaffFit", "Hexatic", "Impacts", "PairCorrelation", "Pressure", "RatioFit",
    "SonineCoefficients", "StructureFactor", "VelocityCorrelation", "VelocityDistribution", "VelocitySpectrum",
    "Data", "Design", "Estimate", "Fit", "Fitted",
    "Interval", "Law",
    "History", "Bodies", "DiskBody", "Hit", "WallBody",
}  # fmt: skip
"""Results: the function that returns one shows it."""

OF_TAICHI = {"normals", "uniforms"}
"""Functions for use inside of a force, which only runs in a simulation: the manual's page on forces has an example."""


DEAR = {
    f"ifrdem.{name}"
    for name in (
        "model.observables.heat_flux", "model.observables.stress", "model.histograms.histogram", "plots.run.walled",
        "plots.run.sheared", "plots.run.driven", "analysis.flow.velocity_correlation", "fit.maximum.fit",
        "fit.report.draws",
    )
}  # fmt: skip
"""Examples that take most of a second: the first three have kernels of their own."""


def test_dear_examples_are_there() -> None:
    assert {*public()} >= DEAR


def write_gas(path: Path) -> None:
    """A trajectory that an example draws: disks at two times."""
    disks = ifrdem.Disks(9, mass=1.0, radius=0.5)
    velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
    with ifrdem.TrajectoryWriter(path, disks, ifrdem.Box((6.0, 6.0))) as file:
        for time in (0.0, 1.0):
            state = ifrdem.State(1.0 + 2.0 * np.argwhere(np.ones((3, 3))), velocity, np.zeros(9), time)
            found = ifrdem.observables.measure(disks, state)
            names = ("temperature", "rotational_temperature", "collisions")
            file.write(state, {name: getattr(found, name) for name in names})


def public() -> dict[str, Any]:
    """Public classes and functions by name, which have an example of their own."""
    found = {}
    for face in FACES:
        names = dir(face) if face is ifrdem else getattr(face, "__all__", None)
        if names is None:
            names = [
                name
                for name, value in vars(face).items()
                if getattr(value, "__module__", "") == face.__name__
            ]
        for name in names:
            value = getattr(face, name)
            if not (inspect.isclass(value) or inspect.isfunction(value)) or name.startswith("_"):
                continue
            if inspect.isclass(value) and (issubclass(value, Exception) or name in MADE_BY_FUNCTIONS):
                continue
            if name not in OF_TAICHI:
                found[f"{value.__module__}.{name}"] = value
    return found


def examples(of: object, name: str) -> doctest.DocTest:
    """The examples in an object's own docstring."""
    parser = doctest.DocTestParser()
    return parser.get_doctest(inspect.getdoc(of) or "", {"__name__": "example"}, name, None, 0)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.full] * (name in DEAR)) for name in [*public(), "ifrdem"]],
)
def test_example_in_the_docstring_prints_the_stated_output(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    test = examples(public().get(name, ifrdem), name)
    for file in (
        re.findall(r'"(\w+\.h5)"', test.docstring or "") if re.search(r"\.plots\.|\.averages\.", name) else ()
    ):
        write_gas(tmp_path / file)
    if '"data.csv"' in (test.docstring or ""):
        (tmp_path / "data.csv").write_text(fit.example())
    assert test.examples, f"{name} has no example"
    if any("import pybullet" in example.source for example in test.examples):
        pytest.importorskip("pybullet", reason="the extra `bullet`, of Python 3.11 and older")
    message: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=message.append)
    assert not message, "".join(message)
