"""Laws by name in case files: runs, records, checkpoints, messages."""

from __future__ import annotations

import math
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter
from support.cases import case_text

import ifrdem
from ifrdem import laws
from ifrdem.case.laws_section import Material, PairOfMaterials
from ifrdem.cli import main as cli
from ifrdem.model.laws.records import LAWS

CASE = case_text({
    "run.collisions_per_disk": 2.0, "run.t_end": None, "material[0].name": "a",
    "material[0].law": "walton", "material[0].beta_0": 0.4, "material[0].e_t": None,
    "species[0].name": "a", "species[0].number": 100, "species[0].material": "a",
})  # fmt: skip
VISCOELASTIC = [
    'material[0].law="viscoelastic"', "material[0].beta_0=", "material[0].e_n=", "material[0].A=0.05",
    "material[0].Y=1.0", "material[0].e_t=-0.9",
]  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "law"),
    [
        ([], laws.Walton(e_n=0.9, beta_0=0.4, mu=0.2)),
        (VISCOELASTIC, laws.Viscoelastic(A=0.05, Y=1.0, e_t=-0.9, mu=0.2)),
        (
            [*VISCOELASTIC[:1], "material[0].e_n=", *VISCOELASTIC[3:5], 'material[0].friction="walton"'],
            laws.Viscoelastic(A=0.05, Y=1.0, mu=0.2, friction="walton", beta_0=0.4),
        ),
        (['material[0].law="smooth"', "material[0].beta_0=", "material[0].mu="], laws.smooth_disks(0.9)),
    ],
    ids=["walton", "viscoelastic", "viscoelastic, Walton's friction", "smooth"],
)
def test_a_run_keeps_the_law_of_its_case(toml: Path, settings: list[str], law: laws.CollisionLaw) -> None:
    out = toml.with_name("gas.h5")
    sets = [word for each in settings for word in ("--set", each)]
    assert cli.main(["run", str(toml), "-o", str(out), *sets]) == 0
    with ifrdem.Trajectory(out) as run:
        assert run.laws == [[law]]
        times = [0.0, 1.0, 3.0]
        by_file, by_hand = (
            ifrdem.theory.prediction(run.disks, given, 0.2, 1.0, 0.0, times) for given in (run.laws, law)
        )
        np.testing.assert_array_equal(by_file.temperature, by_hand.temperature)
        assert by_file.temperature[-1] < 0.9
        assert run.observables["energy"][-1] < run.observables["energy"][0]


def test_a_checkpoint_holds_laws_by_name(toml: Path) -> None:
    gas = ifrdem.Case.read(toml).simulation()
    gas.run(collisions_per_disk=1)
    gas.save_checkpoint(toml.with_name("gas.checkpoint.h5"))
    again = ifrdem.Simulation.from_checkpoint(toml.with_name("gas.checkpoint.h5"))
    for one in (gas, again):
        one.run(collisions_per_disk=2)
    np.testing.assert_array_equal(gas.state.velocity, again.state.velocity)
    np.testing.assert_array_equal(gas.state.spin, again.state.spin)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ('material[0].law="waltn"', "material[0].law = \"waltn\": must be one of 'ifr', 'walton',"),
        ("material[0].law=3", "material[0].law = 3: must be one of 'ifr'"),
        ("material[0].beta_0=2.0", "material[0].beta_0 = 2.0: must be a number from -1 to 1"),
        (
            'material[0].law="smooth"',
            "material[0].beta_0 = 0.4: requires law = 'walton' or 'viscoelastic', not with 'smooth'",
        ),
        ("material[0].e_n=", "material[0].e_n: missing: normal restitution"),
    ],
)
def test_keys_of_other_laws_are_refused_by_key_and_value(
    toml: Path, setting: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["check", str(toml), "--set", setting]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("settings", "shown"),
    [
        (
            ['material[0].law="rough"', "material[0].beta_0=", "material[0].mu=", "material[0].beta=0.5"],
            "(law = rough, e_n = 0.9, beta = 0.5)",
        ),
        (['material[0].law="smooth"', "material[0].beta_0=", "material[0].mu="], "(law = smooth, e_n = 0.9)"),
        ([], "(law = walton, e_n = 0.9, beta_0 = 0.4, mu = 0.2)"),
    ],
)
def test_check_shows_the_law_of_the_case(
    toml: Path, settings: list[str], shown: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["check", str(toml), *(word for each in settings for word in ("--set", each))]) == 0
    assert shown in capsys.readouterr().out


def test_check_shows_e_n_of_viscoelastic_disks_and_refuses_what_the_series_does_not_cover(
    toml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Mean approach speed of equal disks: sqrt(pi / 2) of the rms speed, 1.2533; m_n = 1/2, R = 1/4."""
    sets = [word for each in VISCOELASTIC for word in ("--set", each)]
    assert cli.main(["check", str(toml), *sets]) == 0
    out = capsys.readouterr().out
    b = 1.5 * 0.05 * (2.0 * 0.25**0.5 / 3.0 / 0.5) ** 0.4 * (math.pi / 2) ** 0.1
    e_n = 1.0 - 1.15344 * b + 0.79826 * b**2  # and terms of the order b^(5/2), 1e-3
    (line,) = [line for line in out.splitlines() if "at the mean approach speed at the start" in line]
    found = float(line.split("start")[1].split(" at ")[0])
    assert found == pytest.approx(e_n, abs=1e-3)
    assert " at 1.253" in line
    for command in (["check", str(toml)], ["run", str(toml), "-o", str(toml.with_name("gas.h5"))]):
        assert cli.main([*command, *sets, "--set", "material[0].A=1e40"]) == 2
        assert "material[0]: a, a: A = 1e+40, Y = 1: e_n = " in capsys.readouterr().err
    assert not toml.with_name("gas.h5").exists()


def test_two_laws_in_one_case_are_refused(toml: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = CASE + '\n[[material]]\nname = "b"\ne_n = 0.9\ne_t = -0.9\nmu = 0.1\n'
    text += '[[pair]]\nmaterials = ["a", "b"]\nlaw = "walton"\ne_n = 0.9\nbeta_0 = 0.1\nmu = 0.1\n'
    text += (
        '[[species]]\nname = "b"\nnumber = 10\nmaterial = "b"\nmass = 1.0\nradius = 0.5\nspeed_rms = 1.0\n'
    )
    toml.write_text(text, encoding="utf-8")
    assert cli.main(["check", str(toml)]) == 2
    assert (
        "material[1]: laws of 2 classes, Walton (material[0]), IFRLaw (material[1])"
        in capsys.readouterr().err
    )


def test_check_refuses_disks_that_rest_by_a_law_other_than_ifr(
    toml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    under_gravity = (
        "box.gravity=[0.0,-1.0]", "box.periodic=[true,false]", 'box.material="a"', 'run.collapse="rest"',
        "run.resting_speed=1e-3",
    )  # fmt: skip
    assert cli.main(["check", str(toml), *(word for each in under_gravity for word in ("--set", each))]) == 2
    assert (
        'run.collapse = "rest": cannot be combined with material[0].law = "walton"' in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    "name", [name for name, law in LAWS.items() if law.make is law.kind or "file" not in law.keys]
)
def test_sections_of_a_named_law_have_the_keys_ranges_and_texts_of_its_class(name: str) -> None:
    """A law that is added to `LAWS` has its sections, which other processes find by name."""
    named = LAWS[name]
    given = {key: each.example for key, each in named.keys.items()}
    for union, own in ((Material, {"name": "a"}), (PairOfMaterials, {"materials": ["a", "b"]})):
        (section,) = TypeAdapter(list[union]).validate_python([{"law": name, **own, **given}])  # type: ignore[valid-type]
        assert section.made(2.0) == named.make(**given)
        for key, each in named.keys.items():
            text, example = type(section).about(key)
            assert (text.lower(), example) == (each.text.lower(), each.example)
        assert pickle.loads(pickle.dumps(section)) == section


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["material[0].errors.e_m=0.1"], r"errors\.e_m: is no coefficient \(did you mean 'e_n'\?\)"),
        (["material[0].errors.e_n=-0.1"], r"errors\.e_n = -0\.1: must be a positive"),
        (["material[0].correlations.e_n.mu=0.5"], r"correlations\.e_n\.mu: must be of two coefficients of errors, e_n"),
        (["material[0].correlations.e_n.e_n=1"], r"correlations\.e_n\.e_n: must be of two"),
        (
            ["material[0].errors.mu=0.1", "material[0].correlations.e_n.mu=0.5", "material[0].correlations.mu.e_n=0.5"],
            r"correlations\.mu\.e_n: is given as correlations\.e_n\.mu, too",
        ),
        (
            ["material[0].errors.mu=0.1", "material[0].errors.beta_0=0.1"]
            + [f"material[0].correlations.{pair}=-0.9" for pair in ("e_n.mu", "e_n.beta_0", "mu.beta_0")],
            "correlations: no covariance matrix has these",
        ),
        (["material[0].errors.mu=0.1", "material[0].correlations.e_n.mu=2"], "must be a number from -1 to 1"),
    ],
)  # fmt: skip
def test_errors_of_coefficients_are_checked(
    toml: Path, capsys: pytest.CaptureFixture[str], settings: list[str], message: str
) -> None:
    sets = [word for each in ("material[0].errors.e_n=0.01", *settings) for word in ("--set", each)]
    assert cli.main(["check", str(toml), *sets]) == 2
    assert re.search(message, capsys.readouterr().err)


def test_errors_of_coefficients_change_nothing_in_a_run(toml: Path) -> None:
    changes = [
        "material[0].errors.e_n=0.01",
        "material[0].errors.mu=0.01",
        "material[0].correlations.e_n.mu=0.5",
    ]
    states = []
    for sets in ([], changes):
        gas = ifrdem.Case.read(toml, set=sets).simulation()
        gas.run(collisions_per_disk=1)
        states.append(gas.state.velocity)
    np.testing.assert_array_equal(*states)
