"""Case files: allowed keys and values, refusals, and the gas that they describe."""

from __future__ import annotations

import copy
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from support.cases import MakeCase, Problems, case_gas, case_text

from ifrdem import theory
from ifrdem.case import file as case_file
from ifrdem.case import notices, pair_rules, report, starts, template
from ifrdem.case.case import CaseSections, RunSection, SpeciesSection
from ifrdem.case.estimate import RunEstimate, collision_rates
from ifrdem.case.gas import CaseGas, Species
from ifrdem.case.laws_section import IFRMaterial
from ifrdem.case.messages import models_in
from ifrdem.case.section import Section
from ifrdem.case.walls_section import PolygonWall
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.initial import from_csv
from ifrdem.initial.placement import check_no_overlap
from ifrdem.model.laws.coin_table import coins

SHIPPED = Path(__file__).parents[2] / "cases" / "cooling.toml"

CASE = case_text({
    "run.collisions_per_disk": 5.0, "run.seed": 3, "run.name": None, "run.t_end": None, "run.units": None,
    "material[0].name": "aluminium", "material[0].e_n": 0.87, "material[0].e_t": -0.88,
    "material[0].mu": 0.21, "species[0].number": 100, "species[0].material": "aluminium",
    "species[0].mass": 0.00119, "species[0].radius": 0.0105,
})  # fmt: skip


def sections() -> dict[str, list[type[Section]]]:
    """Sections by name, with all their kinds."""
    return {name: models_in(field.annotation) for name, field in CaseSections.model_fields.items()}


def problems_of_key(section: type[Section], key: str, value: object) -> list[str]:
    """What a section says of one of its keys, whatever else is missing."""
    try:
        section.model_validate({key: value})
    except ValidationError as error:
        return [each["msg"] for each in error.errors() if each["loc"] and each["loc"][0] == key]
    return []


# --- the models -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "model",
    [
        *(model for kinds in sections().values() for model in kinds),
        *(
            model
            for each in (SpeciesSection, PolygonWall)
            for key in each.model_fields.values()
            for model in models_in(key.annotation)
        ),
    ],
    ids=lambda model: model.__name__,
)
def test_every_key_has_a_description_with_its_unit_and_an_example(model: type[Section]) -> None:
    for key in model.model_fields:
        about, example = model.about(key)
        # "cpu" and the like have no unit: their choices stand in quotes
        assert re.search(r"\[.+\]", about) or about.count('"') >= 4, key
        assert example is not None, key


def test_shipped_case_is_the_main_job() -> None:
    case = case_file.read(SHIPPED).case
    (species,), (material,) = case.species, case.material
    # the main job: 1 pta is 1.19 g, 21 mm (Sec. III); 0.87, -0.88, 0.21 (Table II)
    assert (species.number, species.mass, species.diameter, species.k) == (50_000, 1.19e-3, 21.0e-3, 2.0)
    assert (material.e_n, material.e_t, material.mu) == (0.87, -0.88, 0.21)
    assert (species.speed_rms, species.spin_rms) == (1.0, 0.0)
    assert (case.box.packing_fraction, case.run.collisions_per_disk) == (0.25, 50.0)
    assert (case.run.name, case.run.units, case.run.device) == ("cooling", "SI", "cpu")


def test_temperature_instead_of_speed(case: MakeCase) -> None:
    """T = <m v^2> / 2 exactly, of equal disks and of drawn radii, whose energies are equal on average."""
    gas = CaseGas.from_case(case("species[0].speed_rms=", "species[0].temperature=0.002"))
    assert gas.species[0].speed_rms == pytest.approx((2.0 * 0.002 / 1.19e-3) ** 0.5, rel=1e-14)
    spread = (
        "species[0].speed_rms=", "species[0].temperature=0.002", "species[0].mass=", "species[0].radius=",
        "species[0].areal_density=3.4", 'species[0].radii={distribution="uniform", low=5e-3, high=20e-3}',
    )  # fmt: skip
    gas = CaseGas.from_case(case(*spread))
    state, mass = starts.start(gas), gas.disks.mass
    assert 0.5 * np.mean(mass * np.sum(state.velocity**2, axis=1)) == pytest.approx(0.002, rel=1e-12)
    assert gas.species[0].speed_rms == pytest.approx((2.0 * 0.002 * np.mean(1.0 / mass)) ** 0.5, rel=1e-12)
    with pytest.raises(InputError, match="speed_rms cannot be combined with temperature"):
        case("species[0].temperature=0.002")


@pytest.mark.parametrize("kind", template.TEMPLATES)
def test_the_short_template_has_the_same_values_in_a_page(kind):
    text = template.write_short(kind)
    assert tomllib.loads(text) == template.TEMPLATES[kind].values
    assert len(text.splitlines()) <= 50
    assert "mass = 0.00119                  # [kg]" in text or kind == "two_species"


@pytest.mark.parametrize("kind", template.TEMPLATES)
def test_template_passes_every_check(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(template.write(kind), encoding="utf-8")
    case = case_file.read(path).case
    assert case == CaseSections.model_validate(template.TEMPLATES[kind].values)
    assert CaseGas.from_case(case).disks.n == sum(each.number for each in case.species)


@pytest.mark.parametrize("kind", template.TEMPLATES)
def test_template_shows_every_key_once_per_section(kind: str) -> None:
    text = template.write(kind)
    blocks = re.split(r"^(?=(?:# )?\[)", text, flags=re.MULTILINE)[1:]
    names = [re.match(r"(?:# )?\[+(\w+)\]+", block) for block in blocks]
    assert {name[1] for name in names if name} == set(CaseSections.model_fields)
    for name, block in zip(names, blocks, strict=True):
        assert name is not None
        keys = re.findall(r"^(?:# )?(\w+) = ", block, flags=re.MULTILINE)
        assert len(keys) == len(set(keys))
        assert set(keys) == {key for model in sections()[name[1]] for key in model.model_fields}


def test_every_line_behind_a_hash_is_valid_when_it_is_uncommented() -> None:
    text = template.write("cooling")
    attempts = 0
    kinds: list[type[Section]] = [RunSection]
    for line in text.splitlines():
        if heading := re.match(r"(?:# )?\[+(\w+)\]+$", line):
            kinds = sections()[heading[1]]
        elif option := re.match(r"# (\w+ = .+)$", line):
            ((key, value),) = tomllib.loads(option[1]).items()
            # The rest of the section does not matter here: only an error at this key would be wrong.
            able = [each for each in kinds if key in each.model_fields]
            assert any(problems_of_key(each, key, value) == [] for each in able), line
            attempts += 1
    assert attempts > 15


def test_unknown_template_names_the_nearest() -> None:
    with pytest.raises(InputError, match=r"coolin.*did you mean 'cooling'"):
        template.write("coolin")


# --- what is refused --------------------------------------------------------------------------------------


def test_good_case_has_no_mistakes(problems: Problems) -> None:
    assert problems() == []


@pytest.mark.parametrize(
    ("override", "key", "says"),
    [
        ("run.sede=3", "run.sede = 3", r"unknown key \(did you mean 'seed'\?\); known here: name, seed"),
        ("outptu.frames=3", "outptu", r"did you mean 'output'"),
        ("run.seed=1.5", "run.seed = 1.5", "must be"),
        ("run.seed=-1", "run.seed = -1", "must be"),
        ("run.seed=true", "run.seed = true", "must be"),
        ("run.name=a/b", 'run.name = "a/b"', "characters that are not allowed"),
        ("run.device=cdua", 'run.device = "cdua"', r"must be one of 'cpu', 'cuda' \(did you mean 'cuda'\?\)"),
        ("run.units=SI units", 'run.units = "SI units"', "must be one of 'SI', 'reduced'"),
        ("run.threads=0", "run.threads = 0", "must be"),
        ("run.collisions_per_disk=nan", "run.collisions_per_disk = nan", "must be"),
        ("run.collisions_per_disk=inf", "run.collisions_per_disk = inf", "must be"),
        ("run.collisions_per_disk=0", "run.collisions_per_disk = 0", "must be"),
        ("run.t_end=1.0", "run", "must have exactly one of t_end, collisions_per_disk; given: t_end, coll"),
        ("run.collisions_per_disk=", "run", "must have exactly one of .*; given: none"),
        ("run=3", "run = 3", r"must be a table \(\[run\]"),
        (
            "box.packing_fraction=0.95",
            "box.packing_fraction = 0.95",
            "must be a number above 0, at most 0.9069",
        ),
        ("box.packing_fraction=0.6", "box.packing_fraction = 0.6", "too dense for a random start"),
        ("box.lengths=[1.0, 2.0]", "box", "must have exactly one of packing_fraction, lengths"),
        ("box=3", "box = 3", "must be a table"),
        ("material=3", "material = 3", r"must be a list of tables \(\[\[material\]\]"),
        (
            "material[0].e_n=1.2",
            "material[0].e_n = 1.2",
            "must be a number from 0 to 1; .*normal restitution",
        ),
        ("material[0].e_n=nan", "material[0].e_n = nan", "must be a number from 0 to 1"),
        ("material[0].e_n=0.9a", 'material[0].e_n = "0.9a"', "must be a number"),
        ("material[0].e_t=-1.1", "material[0].e_t = -1.1", "must be a number from -1 to 1"),
        ("material[0].mu=-0.1", "material[0].mu = -0.1", "must be"),
        ("material[0].mu=", "material[0]", "missing: mu, or coin"),
        (
            "material[0].sticking=centre",
            'material[0].sticking = "centre"',
            "must be one of 'percussion_center', 'contact_point'",
        ),
        ("material[0].coin=1 pta", "material[0]", "e_n, e_t, mu cannot be combined with coin"),
        ("material[0].name=", "material[0].name", "missing: name that species"),
        ("species=[]", "species", "must have at least 1 entry, none given"),
        ("species[0].number=0", "species[0].number = 0", "must be an integer from 1 to 4294967295"),
        ("species[0].number=2.5", "species[0].number = 2.5", "must be an integer from 1 to 4294967295"),
        ("species[0].mass=0.0", "species[0].mass = 0.0", "must be"),
        (
            "species[0].diameter=0.1",
            "species[0]",
            "must have exactly one of radius, diameter, radii, or coin; given: radius, diameter",
        ),
        ("species[0].material=aluminum", 'species[0].material = "aluminum"', "did you mean 'aluminium'"),
        ("species[0].material=", "species[0].material", "missing: give the name of a material.*aluminium"),
        ("species[0].speed_rms=0", "run.collisions_per_disk = 5", "nothing moves"),
        ("species[0].number=2", "box = ", "more than a third of a periodic side"),
        ("start.positions=hexagon", 'start.positions = "hexagon"', "did you mean 'hexagonal'"),
        ("start.file=no.csv", 'start.file = "no.csv"', "no such file"),
        ("output.frames=0", "output.frames = 0", "must be an integer from 1 to 10000000"),
        ("output.fields=['spin']", 'output.fields[0] = "spin"', "'position'"),
        ("output.picture=1", "output.picture = 1", "must be a boolean"),
        ("output.precision=f2", 'output.precision = "f2"', "must be one of 'f32', 'f64'"),
        (
            "output.precision=f8",
            'output.precision = "f8"',
            r"must be one of 'f32', 'f64' \(it is called \"f64\" now\)",
        ),
        ("output.precision=double", 'output.precision = "double"', r"did you mean 'f64'"),
        ("run.precision=f4", 'run.precision = "f4"', r'it is called "f32" now'),
    ],
)
def test_wrong_value_is_named_with_what_is_allowed(
    problems: Problems, override: str, key: str, says: str
) -> None:
    found = problems(override)
    assert len(found) == 1, found
    assert found[0].startswith(key)
    assert re.search(says, found[0])


def test_one_disk_alone_cannot_be_run_to_a_number_of_collisions(problems: Problems) -> None:
    alone = ("species[0].number=1", "box.packing_fraction=", "box.lengths=[1.0, 1.0]")
    (found,) = problems(*alone)
    assert found.startswith("run.collisions_per_disk = 5: one disk alone never collides")
    assert problems(*alone, "run.collisions_per_disk=", "run.t_end=1.0") == []


def test_one_disk_alone_has_no_expected_collisions(case: MakeCase) -> None:
    gas = CaseGas.from_case(
        case(
            "species[0].number=1",
            "box.packing_fraction=",
            "box.lengths=[9.0, 9.0]",
            "run.collisions_per_disk=",
            "run.t_end=3",
        )
    )
    estimate = RunEstimate.of(gas)
    assert (estimate.collision_rate, estimate.collisions) == ((0.0,), 0.0)
    shown = report.report(gas, estimate).text
    assert "none: one disk alone never collides" in shown
    assert "nothing moves" not in shown


def test_every_mistake_is_reported_at_once(toml: Path) -> None:
    types = {"run.sede": "3", "box.packing_fraction": "0.95", "material[0].e_n": "1.2", "output.frames": "0"}
    rules = {"species[0].material": "steel", "species[0].number": "2", "output.histories": "[100]"}
    # keys, types and ranges first; then what needs several sections
    for wrong, keys in ((rules | types, set(types)), (rules, {*rules, "box"} - {"species[0].number"})):
        with pytest.raises(InputError) as error:
            case_file.read(toml, [f"{key}={value}" for key, value in wrong.items()])
        lines = str(error.value).splitlines()
        assert {line.split(" = ")[0] for line in lines} == {f"{toml}: {key}" for key in keys}
        assert all(line.endswith("[set on the command line]") for line in lines if "box = " not in line)


def test_a_run_validates_its_case_once(toml: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From reading it to the first frame: a start file is read and pairs are judged once."""
    done: list[str] = []

    def counted(module: Any, name: str) -> None:
        original = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *a, **k: done.append(name) or original(*a, **k))

    monkeypatch.chdir(tmp_path)
    rows = "x,y,vx,vy,spin\n1,1,1,0,0\n3,1,-1,0,0\n"
    wanted = [*start_case(tmp_path, rows), "species[0].speed_rms=", "run.collisions_per_disk=1.0"]
    for module, name in ((from_csv, "read"), (pair_rules, "verdicts")):
        counted(module, name)
    assert (
        main(["run", str(toml), "--no-picture", *(word for each in wanted for word in ("--set", each))]) == 0
    )
    assert sorted(done) == ["read", "verdicts"]


def test_mistakes_of_one_section_and_a_wrong_combination_of_keys_are_all_found(problems: Problems) -> None:
    found = problems("run.t_end=-1.0", "run.seed=x", "run.colour=red")
    assert [line.split()[0].rstrip(":") for line in found] == ["run", "run.seed", "run.t_end", "run.colour"]


def test_unknown_key_does_not_hide_the_physics(problems: Problems) -> None:
    found = problems("material[0].e_nn=0.9", "material[0].e_t=0.3", "material[0].e_n=1.0")
    assert len(found) == 2
    assert found[0].startswith("material[0].e_nn")
    assert "would add energy" in found[1]


@pytest.mark.parametrize(
    ("text", "says"),
    [("[run\n", "not valid TOML.*line 1"), ("x = nan\nx = 2\n", "not valid TOML"), ("", "run: missing")],
)
def test_file_that_is_no_case_is_refused(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=says):
        case_file.read(path)


def test_missing_file_names_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "cooling.toml").write_text(CASE, encoding="utf-8")
    with pytest.raises(
        InputError, match=r"colling\.toml: there is no such file \(did you mean 'cooling\.toml'"
    ):
        case_file.read(tmp_path / "colling.toml")
    with pytest.raises(InputError, match="cannot be read"):
        case_file.read(tmp_path)


def test_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file in UTF-8"):
        case_file.read(tmp_path / "a.toml")


# --- overrides --------------------------------------------------------------------------------------------


def test_overrides_reach_every_kind_of_key(case: MakeCase) -> None:
    made = case(
        "run.seed=7",
        "species.0.number=12",
        "species[0].name = big one",
        'run.name="x"',
        "output.picture=false",
    )
    assert made.run.seed == 7
    assert made.species[0].number == 12
    assert made.species[0].name == "big one"  # what is not TOML is text
    assert made.run.name == "x"
    assert made.output.picture is False


def test_later_override_wins_and_an_empty_one_removes(case: MakeCase) -> None:
    made = case("run.seed=7", "run.seed=8", "run.collisions_per_disk=", "run.t_end=2")
    assert (made.run.seed, made.run.t_end, made.run.collisions_per_disk) == (8, 2.0, None)


def test_line_break_in_a_value_brings_no_further_keys() -> None:
    raw: dict[str, Any] = {"run": {}}
    case_file.override(raw, "run.name=1\nseed = 5")
    assert raw == {"run": {"name": "1\nseed = 5"}}


@pytest.mark.parametrize(
    ("assignment", "says"),
    [
        ("run.seed", "must be KEY=VALUE"),
        ("=3", "must be KEY=VALUE"),
        ("run..seed=3", "must be KEY=VALUE"),
        ("species[3].number=1", "has 1 entries, numbered from 0"),
        ("species.number=1", "species is a list: give a number"),
        ("run.seed.x=1", r"run\.seed is no table"),
    ],
)
def test_override_that_leads_nowhere_is_refused(assignment: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        case_file.override(tomllib.loads(CASE), assignment)


def test_disks_of_no_real_areal_density_are_doubted() -> None:
    """A coin of 1.19 g and 21 mm has m / (pi R^2) = 3.44 kg/m^2: 1e6 times less in mm, 1e3 times more in g."""
    si = "run.units=SI"
    for mass, diameter, density in ((1.19e-3, 21.0, "3.44e-06"), (1.19, 0.021, "3.44e+03")):
        given = ("species[0].radius=", f"species[0].diameter={diameter}", f"species[0].mass={mass}")
        (text,) = notices.notices(case_gas(*given, si))
        assert text.startswith(f"disks of species 'coins' have {density} kg/m^2")
        assert notices.notices(case_gas(*given)) == []


# --- laws and energy --------------------------------------------------------------------------------------


def test_admissibility_depends_on_the_k_of_the_species(problems: Problems) -> None:
    # Percussion centre: strict for e_t <= (1 - kbar)/2, so e_t = 0 is right for hoops (k = 1), not for disks.
    # At e_n = 1 no loss along the line of centres can save it: a (1 - e_n) = 0 is less than
    # (e_s^2 - 1) (1 + e_n) mu^2/c^2.
    wrong = ("material[0].e_n=1.0", "material[0].e_t=0.0")
    assert len(problems(*wrong)) == 1
    assert "a collision would add energy" in problems(*wrong)[0]
    assert "pass their k" not in problems(*wrong)[0]
    assert problems(*wrong, "species[0].k=1.0") == []


def test_law_saved_by_the_total_budget_only_is_allowed_with_a_warning(case: MakeCase) -> None:
    # k = 2: a = 3, c = 1/2, e_s = 0 + 3/2 > 1, not strict; but a (1 - e_n) = 1.5 is more than
    # (e_s^2 - 1) (1 + e_n) mu^2/c^2 = (9/4 - 1) 1.5 0.01/0.25 = 0.075.
    gas = CaseGas.from_case(case("material[0].e_n=0.5", "material[0].e_t=0", "material[0].mu=0.1"))
    (verdict,) = gas.verdicts
    assert (verdict.admissible, verdict.strict) == (True, False)
    assert len(notices.warnings(gas)) == 1
    assert "only the loss along the line of centres" in notices.warnings(gas)[0]


TWO = (
    CASE
    + """
[[material]]
name = "steel"
e_n = 0.9
e_t = -0.95
mu = 0.1
[[species]]
name = "balls"
number = 50
material = "steel"
mass = 2.0e-3
radius = 5.0e-3
speed_rms = 0.5
"""
)
PAIR = """
[[pair]]
materials = ["steel", "aluminium"]
e_n = 0.7
e_t = -0.9
mu = 0.3
"""


def test_pair_of_materials_without_coefficients_is_refused(problems: Problems) -> None:
    (found,) = problems(text=TWO)
    assert found == (
        "pair: missing for the materials 'aluminium' and 'steel': give their e_n, e_t and mu in a [[pair]]"
    )


def test_pair_gives_the_law_in_both_orders(case: MakeCase) -> None:
    gas = CaseGas.from_case(case(text=TWO + PAIR))
    assert gas.materials == ("aluminium", "steel")
    assert gas.laws[0][1].table_row() == gas.laws[1][0].table_row() == (0.7, -0.9, 0.3, 0.0, 0.0)
    assert gas.laws[0][0].table_row() == (0.87, -0.88, 0.21, 0.0, 0.0)
    assert gas.laws[1][1].table_row() == (0.9, -0.95, 0.1, 0.0, 0.0)
    assert gas.disks.material.tolist() == [0] * 100 + [1] * 50


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            "pair[0].materials=['steel', 'aluminum']",
            "no material is called 'aluminum'.*did you mean 'aluminium'",
        ),
        ("pair[0].materials=['steel', 'steel']", "two different names"),
        ("pair[0].materials=['steel']", "must have at least 2 entries, 1 given"),
        ("material[1].name=aluminium", "the name of material.0. too"),
        ("species[1].name=coins", "the name of species.0. too"),
    ],
)
def test_wrong_names_of_pairs_and_sections_are_found(problems: Problems, change: str, says: str) -> None:
    assert any(re.search(says, line) for line in problems(change, text=TWO + PAIR))


def test_coin_brings_mass_size_and_law(problems: Problems, case: MakeCase) -> None:
    text = """
    run.collisions_per_disk = 1
    box.packing_fraction = 0.2
    [[species]]
    name = "pesetas"
    coin = "1 pta"
    number = 10
    speed_rms = 1.0
    """
    gas = CaseGas.from_case(case(text=text))
    assert gas.disks.mass.tolist() == [1.19e-3] * 10  # Sec. III
    assert gas.disks.radius.tolist() == [10.5e-3] * 10
    assert gas.laws[0][0].table_row() == (0.87, -0.88, 0.21, 0.0, 0.0)  # Table II
    assert problems("species[0].k=2.0", text=text) == ["species[0]: k cannot be combined with coin"]
    assert "did you mean '1 pta'" in problems("species[0].coin=1 peseta", text=text)[0]
    assert "in SI" in problems("run.units=reduced", text=text)[0]


def test_coins_of_two_kinds_take_the_papers_pair_and_no_other() -> None:
    case = CaseSections.model_validate(template.TEMPLATES["two_species"].values)
    assert CaseGas.from_case(case).laws[0][1] == coins.pair("500 pts", "100 pts")
    other = copy.deepcopy(dict(template.TEMPLATES["two_species"].values))
    del other["pair"]
    other["material"] = [{"name": "small", "coin": "1 pta"}, other["material"][1]]
    (found,) = [str(each) for each in case_file.validate_parsed(other, Path())[-1]]
    assert "missing for the materials 'small' and 'large'" in found


# --- the start --------------------------------------------------------------------------------------------


def test_start_has_the_given_speeds_no_momentum_and_no_overlap(case: MakeCase) -> None:
    made = case("species[1].spin_rms=4.0", text=TWO + PAIR)
    gas = CaseGas.from_case(made)
    state = starts.start(gas)
    square, mass = np.sum(state.velocity**2, axis=1), gas.disks.mass
    # rounding of sums of 100 numbers of order 1
    assert mass @ square == pytest.approx(mass[:100].sum() * 1.0 + mass[100:].sum() * 0.25, rel=1e-13)
    # of each species within 4 standard errors, 1 / sqrt(n) of v^2
    assert np.mean(square[:100]) == pytest.approx(1.0, rel=0.4)
    assert np.mean(square[100:]) == pytest.approx(0.25, rel=0.57)
    assert np.all(state.spin[:100] == 0.0)
    assert math.sqrt(np.mean(state.spin[100:] ** 2)) == pytest.approx(4.0, rel=1e-13)
    assert np.abs(gas.disks.mass @ state.velocity).max() < 1e-15  # of a momentum scale of 0.1 kg m/s
    check_no_overlap(gas.box, gas.disks.radius, state.position)
    assert gas.box.packing_fraction(gas.disks.radius) == pytest.approx(0.2, rel=1e-13)


def test_seed_decides_the_start_and_species_draw_apart(case: MakeCase) -> None:
    text = TWO.replace("number = 50", "number = 100") + PAIR
    states = [
        starts.start(CaseGas.from_case(made))
        for made in (case(text=text), case(text=text), case("run.seed=4", text=text))
    ]
    np.testing.assert_array_equal(states[0].velocity, states[1].velocity)
    np.testing.assert_array_equal(states[0].position, states[1].position)
    assert not np.any(states[0].velocity == states[2].velocity)
    # 200 pairs of independent normal numbers correlate by 0.07 on average; one shared stream would give 1.
    both = states[0].velocity
    assert abs(np.corrcoef(both[:100].ravel(), both[100:].ravel())[0, 1]) < 0.3


def test_dense_gas_starts_on_a_lattice(problems: Problems, case: MakeCase) -> None:
    dense = ("box.packing_fraction=0.7", "start.positions=hexagonal")
    assert problems(*dense) == []
    made = case(*dense)
    gas = CaseGas.from_case(made)
    check_no_overlap(gas.box, gas.disks.radius, starts.start(gas).position)
    (found,) = problems("box.packing_fraction=0.9", "start.positions=hexagonal")
    assert found.startswith('start.positions = "hexagonal": 100 disks')


def test_random_start_that_fails_late_names_the_key(case: MakeCase) -> None:
    # Two sizes: what is too dense for them is found by trying. 0.7 is beyond the 0.547 at which random
    # sequential addition of equal disks ends, and a size ratio of 1.1 adds little.
    second = CASE[CASE.index("[[species]]") :].replace("coins", "larger").replace("0.0105", "0.0115")
    made = case("box.packing_fraction=0.7", text=CASE + second)
    with pytest.raises(InputError, match=r'^start\.positions = "random": packing fraction = 0\.7'):
        starts.start(CaseGas.from_case(made))


def start_case(tmp_path: Path, rows: str, *, number: int = 2) -> list[str]:
    (tmp_path / "start.csv").write_text(rows, encoding="utf-8")
    return [
        f"species[0].number={number}",
        "species[0].radius=0.5",
        "box.packing_fraction=",
        "box.lengths=[10.0, 8.0]",
        "start.file=start.csv",
    ]


def test_a_csv_file_for_positions_is_refused_with_the_right_key(problems: Problems, tmp_path: Path) -> None:
    (found,) = problems("start.positions=start.csv", folder=tmp_path)
    assert found.endswith('; a CSV file is named by file = "start.csv"')


def test_start_file_gives_positions_and_motion(problems: Problems, case: MakeCase, tmp_path: Path) -> None:
    rows = "# made by hand\nspin, x, y, vx, vy\n0.5, 1.0, 1.0, 3.0, 4.0\n\n-0.5, 5.0, 7.9, 0.0, 0.0\n"
    wanted = [*start_case(tmp_path, rows), "species[0].speed_rms="]
    assert problems(*wanted, folder=tmp_path) == []
    made = case(*wanted)
    gas = CaseGas.from_case(made, tmp_path)
    state = starts.start(gas)
    assert state.position.tolist() == [[1.0, 1.0], [5.0, 7.9]]
    assert state.velocity.tolist() == [[3.0, 4.0], [0.0, 0.0]]
    assert state.spin.tolist() == [0.5, -0.5]
    # Velocities (3, 4) and 0: relative to their mean, both are half of it. Collisions go by that.
    assert gas.species[0].speed_rms == pytest.approx(2.5, rel=1e-14)


def test_start_file_with_positions_only_leaves_the_speeds_to_the_species(
    case: MakeCase, tmp_path: Path
) -> None:
    made = case(*start_case(tmp_path, "x,y\n1.0,1.0\n5.0,7.9\n"))
    state = starts.start(CaseGas.from_case(made, tmp_path))
    assert math.sqrt(np.mean(np.sum(state.velocity**2, axis=1))) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ("x,y\n1.0,0.2\n1.0,7.9\n", r"disks 0 and 1 overlap by 0\.7 "),  # 0.3 apart, across the side
        ("x,y\n1.0,1.0\n1.9,1.0\n", r"disks 0 and 1 overlap by 0\.1 "),
        ("x,y\n1.0,1.0\n", "has 1 disks: must be 2, the sum of the species' numbers"),
        ("x,y\n1.0,nan\n3.0,3.0\n", "line 2: y = nan: must be a finite number"),
        ("x,y\n1.0,1.0\n3.0,abc\n", "line 3: y = abc: must be a number"),
        ("x,y\n1.0,1.0\n3.0\n", r"line 3: 1 value: must be 2 \(x, y\)"),
        ("x,y\n1.0,1.0\n3.0,8.0\n", "line 3: y = 8: must lie inside the box, from 0 to below 8"),
        ("x,z\n1.0,1.0\n3.0,3.0\n", "unknown column 'z'.*there are x, y, vx, vy, spin"),
        ("x,vx\n1.0,1.0\n3.0,3.0\n", "missing column y, vy, spin"),
        ("x,y,spn\n", r"unknown column 'spn' \(did you mean 'spin'\?\)"),
        ("x,y,x\n1,1,1\n", "column 'x' is given twice"),
        ("", "is empty"),
        ("x,y\n1_0,1\n3.0,3.0\n", "line 2: x = 1_0: must be a number"),
        ("x,y\n1.0,nan\n3.0,abc\n", "line 2: y = nan: must be a finite number"),
        ("x,y\n1.0,\n3.0,3.0\n", "line 2: y = nothing: must be a finite number"),
        ("x;y\n1;1\n", r'here are semicolons; start\.delimiter = ";" reads them'),
        ("x\ty\n1\t1\n", r'here are tabs; start\.delimiter = "\\t" reads them'),
        ("x|y\n1|1\n", r'here are bars; start\.delimiter = "\|" reads them'),
        ("x y\n1 1\n", r'here are blanks; start\.delimiter = " " reads them'),
        ('x,y\n"1,5",1\n3.0,3.0\n', r'x = 1,5: must be a number; start\.decimal = "," reads a comma'),
        ("x,y,spinn\n", r"did you mean 'spin'\?\); start\.columns = \{spin = \"spinn\"\} says that it is"),
    ],
)
def test_wrong_start_file_is_refused_by_line(
    problems: Problems, rows: str, says: str, tmp_path: Path
) -> None:
    found = problems(*start_case(tmp_path, rows), folder=tmp_path)
    assert any(re.search(says, line) for line in found), found
    assert all(line.startswith('start.file = "start.csv": ') for line in found)


@pytest.mark.parametrize("rows", ["1.0,1.0\n5.0,7.9\n", "# x y\n\n1e0, -1,0,0,.5\n3,3,0,0,0\n"])
def test_start_file_without_header_is_refused_in_one_line(
    problems: Problems, tmp_path: Path, rows: str
) -> None:
    (found,) = problems(*start_case(tmp_path, rows), folder=tmp_path)
    first = next(i for i, row in enumerate(rows.splitlines(), start=1) if row[:1].isdigit())
    assert found.startswith(f'start.file = "start.csv": line {first}: there is no header')
    assert "must name the columns (x, y, vx, vy, spin, id)" in found


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ("x,y\n1,1\n5,5\n", "the columns vx, vy, spin or a species speed_rms above 0"),
        ("x,y,vx,vy,spin\n1,1,0,0,1\n5,5,0,0,0\n", "vx = vy = 0"),
    ],
)
def test_start_file_at_rest_cannot_be_run_to_a_number_of_collisions(
    problems: Problems, tmp_path: Path, rows: str, says: str
) -> None:
    wanted = [*start_case(tmp_path, rows), "species[0].speed_rms="]
    (found,) = problems(*wanted, folder=tmp_path)
    assert found.startswith("run.collisions_per_disk = 5: nothing moves at the start")
    assert 'start.file = "start.csv"' in found
    assert says in found
    assert problems(*wanted, "run.collisions_per_disk=", "run.t_end=1.0", folder=tmp_path) == []


def test_start_file_with_other_names_units_and_small_overlaps(
    problems: Problems, case: MakeCase, tmp_path: Path
) -> None:
    """0.04 apart too little: each of the two moves by half of it; another pair beyond relax is named with all others."""
    rows = "pos x (mm);v;y;nr\n1000,0;0;1,0;1\n1960,0;0;1,0;2\n"
    wanted = [
        *start_case(tmp_path, rows),
        'start.columns={x = "pos x (mm)"}', 'start.delimiter=";"', 'start.decimal=","', "start.relax=0.05",
    ]  # fmt: skip
    made = case(*wanted)
    position = starts.start(CaseGas.from_case(made, tmp_path)).position
    np.testing.assert_allclose(position, [[0.98, 1.0], [1.98, 1.0]], atol=1e-6)
    found = problems(*wanted, "start.relax=0.03", folder=tmp_path)
    assert found == ['start.file = "start.csv": disks 0 and 1 overlap by 0.04, more than relax = 0.03']
    (found,) = problems(*wanted, 'start.units={x = "mn"}', folder=tmp_path)
    assert "unit x=mn: must be m, cm, mm, um, micron or a positive factor (did you mean 'm" in found
    (found,) = problems("start.relax=0.1", 'start.positions="random"', folder=tmp_path)
    assert "relax" in found


def test_speeds_in_the_case_and_in_the_start_file_contradict(problems: Problems, tmp_path: Path) -> None:
    wanted = start_case(tmp_path, "x,y,vx,vy,spin\n1,1,1,0,0\n3,3,-1,0,0\n")
    (found,) = problems(*wanted, folder=tmp_path)
    assert found.startswith("species[0].speed_rms = 1: cannot be combined with velocities in the start file")


# --- estimates --------------------------------------------------------------------------------------------


def species(number: int, radius: float, speed: float) -> Species:
    return Species("a", "m", number, 1.0, radius, 2.0, speed, 0.0)


def test_collision_rate_of_equal_disks_is_enskogs() -> None:
    # 8 phi g sqrt(T/(pi m))/sigma with sigma = m = T = 1 and the virial series: 2.3996 at phi = 0.3.
    area = 1000 * math.pi / 4.0 / 0.3
    (rate,) = collision_rates([species(1000, 0.5, math.sqrt(2.0))], area)  # T = m v_rms^2 / 2
    assert rate == pytest.approx(2.3996, rel=1e-4)  # ways to sum the virial series differ by a few 1e-5


def test_collision_rate_does_not_care_how_equal_disks_are_divided() -> None:
    area = 1000 * math.pi / 4.0 / 0.3
    rates = collision_rates([species(700, 0.5, 1.0), species(300, 0.5, 1.0)], area)
    (whole,) = collision_rates([species(1000, 0.5, 1.0)], area)
    np.testing.assert_allclose(rates, whole, rtol=1e-13)  # rounding


def test_points_among_resting_disks_fly_the_free_path_of_a_lorentz_gas() -> None:
    # Points see disks of radius R at rest: rate = n 2R v / (1 - phi), exactly, as they have the part 1 - phi
    # of the area to themselves; for a Maxwellian the mean speed is sqrt(pi)/2 of v_rms.
    area, R, v = 100 * math.pi * 0.25 / 0.4, 0.5, 2.0
    rates = collision_rates([species(100, R, 0.0), species(1, 1e-9, v)], area)
    expected = 100 / area * 2.0 * R * (math.sqrt(math.pi) / 2.0 * v) / (1.0 - 0.4)
    assert rates[1] == pytest.approx(expected, rel=1e-6)  # the points' size is 1e-9


def test_estimate_of_the_main_job() -> None:
    file = case_file.read(SHIPPED)
    gas = CaseGas.from_case(file.case, file.folder)
    estimate = RunEstimate.of(gas)
    assert estimate.collisions == 1_250_000  # 50,000 disks x 50 / 2
    assert estimate.packing_fraction == pytest.approx(0.25, rel=1e-13)
    # n = phi / (pi R^2)
    assert estimate.number_density == pytest.approx(0.25 / (math.pi * 10.5e-3**2), rel=1e-13)
    # pi sigma / (8 sqrt 2 phi g) with g = (1 - 7 phi/16)/(1 - phi)^2, good to 1e-3 at this density
    g = (1.0 - 7.0 * 0.25 / 16.0) / 0.75**2
    assert estimate.free_path[0] == pytest.approx(
        math.pi * 0.021 / (8.0 * math.sqrt(2.0) * 0.25 * g), rel=2e-3
    )
    # 101 frames in four pieces of position, velocity, image (2 x 4 bytes each), spin and count (4 each), which begin on
    # pages of 4096 bytes: 100,000 bytes take 25 of them, 50,000 take 13. And 2 % more.
    assert estimate.file_bytes == pytest.approx(1.02 * 101 * 4 * (3 * 25 + 2 * 13) * 4096, rel=0.02)


def test_estimate_counts_the_kicks_of_tracked_disks(case: MakeCase) -> None:
    """100 disks, 500 steps to the end: 50,000 events of 177 bytes, in addition to those of collisions."""
    sizes = []
    for step in (1.0, 2e-3):
        kicks = {"kind": "random_kicks", "step": step, "power": 1e-6}
        made = case(
            {
                "run.t_end": 1.0,
                "run.collisions_per_disk": None,
                "output.histories_all": True,
                "force": [kicks],
            }
        )
        sizes.append(RunEstimate.of(CaseGas.from_case(made)).file_bytes)
    assert sizes[1] - sizes[0] == pytest.approx(177 * 100 * 499, rel=0.05)


def test_expected_end_is_where_theory_has_the_given_collisions(case: MakeCase) -> None:
    made = case()
    gas = CaseGas.from_case(made)
    estimate = RunEstimate.of(gas)
    T = 0.5 * 1.19e-3
    _, _, per_disk = theory.cooling(gas.laws[0][0], 1.19e-3, 10.5e-3, 2.0, 0.2, T, 0.0, [estimate.end_time])
    assert per_disk[0] == pytest.approx(5.0, rel=1e-5)  # the root is sought to 1e-6
    timed = case("run.collisions_per_disk=", f"run.t_end={estimate.end_time}")
    assert RunEstimate.of(CaseGas.from_case(timed)).collisions == pytest.approx(250.0, rel=1e-5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        # One temperature: the balls' speed is sqrt(1.19 / 2) of the coins'. Both only cool.
        ([f"species[1].speed_rms={(1.19 / 2.0) ** 0.5}"], "at most"),
        ([], "about"),  # the coins heat the balls
        ([f"species[1].speed_rms={(1.19 / 2.0) ** 0.5}", "pair[0].e_n=1.0", "pair[0].e_t=-1.0"], "about"),
        (
            [f"species[1].speed_rms={(1.19 / 2.0) ** 0.5}", "species[0].spin_rms=100.0"],
            "about",
        ),  # T_rot = 1.1 T
    ],
)
def test_mixture_run_to_a_time_gets_a_bound_only_if_it_cools(
    case: MakeCase, changes: list[str], message: str
) -> None:
    made = case("run.collisions_per_disk=", "run.t_end=0.1", *changes, text=TWO + PAIR)
    gas = CaseGas.from_case(made)
    estimate = RunEstimate.of(gas)
    assert estimate.collisions_are == message
    words = report.report(gas, estimate).text
    assert f": {message} {estimate.collisions:.4g} collisions" in words
    assert (", by the rate at the start" in words) == (message == "about")
    numbers, rates = np.array([100, 50]), np.array(estimate.collision_rate)
    assert estimate.collisions == pytest.approx(0.5 * 0.1 * numbers @ rates, rel=1e-12)


def test_models_forbid_unknown_keys() -> None:
    with pytest.raises(ValidationError, match="Extra inputs"):
        SpeciesSection.model_validate({"name": "a", "number": 1, "coin": "1 pta", "colour": "red"})
    with pytest.raises(ValidationError, match="missing: e_n"):
        IFRMaterial.model_validate({"name": "a"})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a = " + "[" * 3000 + "]" * 3000, "stand in each other more than 16 deep"),
        ("a = " + "{b = " * 3000 + "1" + "}" * 3000, "stand in each other more than 16 deep"),
        (".".join("a" * 50_000) + " = 1", "more than 16 parts"),
        ("[" + " . ".join(["'a'"] * 50) + "]", "more than 16 parts"),
        ("a = " + "1" * 5000, "not valid TOML: Exceeds the limit"),
    ],
)
def test_what_the_parser_of_toml_cannot_take_is_refused(tmp_path, text, reason):
    """Its recursion ends at 1,000; a key of n parts takes it n^2 words of memory; Python reads 4,300 digits."""
    path = tmp_path / "odd.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=reason) as caught:
        case_file.read(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    "comment",
    [
        "# " + "[" * 50,
        "# " + "a." * 50,
        'x = "' + "a.{" * 50 + '"',
        "x = '''\n" + "[" * 50 + "'''",
        r'x = "\"[[[[[[[[[[[[[[[[["',
    ],
)
def test_brackets_and_dots_in_comments_and_texts_are_no_nesting(tmp_path, comment):
    path = tmp_path / "case.toml"
    path.write_text(comment + "\n" + CASE)
    if comment.startswith("#"):
        case_file.read(path)
    else:
        with pytest.raises(InputError, match=r"x = .*: unknown key"):
            case_file.read(path)


def test_keys_of_the_command_line_are_those_of_cases(toml):
    for key in ("run.²", "run.séed", ".".join("a" * 50_000), f"species[{'9' * 5000}].k"):
        with pytest.raises(InputError, match=r"must be KEY=VALUE") as caught:
            case_file.read(toml, [f"{key}=1"])
        assert len(str(caught.value)) < 200


def test_of_many_mistakes_twenty_and_their_number_are_listed(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(CASE + "[[species]]\nfoo = 1\n" * 1000)
    with pytest.raises(InputError) as caught:
        case_file.read(path)
    lines = str(caught.value).splitlines()
    assert len(lines) == 21
    assert re.fullmatch(r"and \d{4} more mistakes like these", lines[-1])


UNITS = ": choose other units (r"


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("species[0].speed_rms", 1e300, UNITS),
        # Other units do not change pure numbers.
        ("species[0].k", 1e300, "must be"),
        ("species[0].k", 1e-300, "must be"),
        ("material[0].mu", 1e300, "must be"),
        ("box.packing_fraction", 1e-300, "must be a number above 0, at most 0.9069"),
        ("box.shear_rate", -1e300, UNITS),
    ],
)
def test_numbers_whose_products_overflow_are_refused_by_key_and_range(toml, key, value, says):
    with pytest.raises(InputError) as caught:
        case_file.read(toml, [f"{key}={value}"])
    (line,) = str(caught.value).splitlines()
    assert f"{key} = {value}: must be" in line
    assert says in line
    assert ("units" in line) == (says == UNITS)


def test_a_second_error_next_to_a_wrong_choice_is_reported_too(toml):
    with pytest.raises(InputError) as caught:
        case_file.read(toml, ["run.t_end=1e300"])
    printed = str(caught.value)
    assert "exactly one of t_end" in printed
    assert "run.t_end = 1e+300: must be" in printed


def test_a_collapse_that_is_no_text_is_refused(toml):
    with pytest.raises(InputError, match=r"run\.collapse: must be"):
        case_file.read(toml, ['run.collapse=["rest"]'])


@pytest.mark.parametrize(
    ("text", "reason"), [("1e-400", "too small for a number"), ("1e400", "too large for a number")]
)
def test_a_number_that_rounds_to_nothing_or_infinity_is_refused(tmp_path, text, reason):
    """TOML leaves it to the reader: a mass of 1e400 was immovable, a friction of 1e-400 none."""
    (tmp_path / "case.toml").write_text(CASE.replace("mu = 0.21", f"mu = {text}"))
    with pytest.raises(InputError, match=f"not valid TOML: {text} is {reason}"):
        case_file.read(tmp_path / "case.toml")


DISSIPATING = ['output.fields=["position","dissipated"]']
FALLING = ["species[0].speed_rms=0", "box.periodic=[true,false]", "box.gravity=[0,-1e36]",
           'box.material="aluminium"']  # fmt: skip
BEYOND = 'output.precision = "f32": the field dissipated: energies of disks of'


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        (["species[0].speed_rms=1e40"], r'output\.precision = "f32": a velocity of \d.*cannot be stored'),
        (["species[0].spin_rms=1e40"], r'output\.precision = "f32": a spin of'),
        ([*DISSIPATING, "species[0].speed_rms=1e20"], BEYOND),
        ([*DISSIPATING, "species[0].mass=1e-39"], BEYOND),
        ([*DISSIPATING, *FALLING], BEYOND),
        (["species[0].speed_rms=1e-30"], "more than 1e27, the longest time of the engine"),
        (["species[0].speed_rms=1e-17", "run.precision=f32"], "what f32 can compute with"),
        (["species[0].speed_rms=1e-17", "run.precision=f32", "start.positions=hexagonal"], "what f32 can"),
        (
            ["force=[{kind='rescale',step=0.1,temperature=1e39}]", "run.precision=f32"],
            "what f32 can compute with",
        ),
    ],
)
def test_a_check_refuses_the_magnitudes_that_a_run_refuses(case, toml, overrides, reason):
    """Speeds of 1e40 are beyond single precision, 3.4e38; their squares at 1e-17, 1e-34, below what f32 resolves."""
    with pytest.raises(InputError, match=reason):
        case_file.read(toml, overrides)
    made = case(*overrides)
    with pytest.raises(InputError, match=reason):
        CaseGas.from_case(made)
    if "precision" not in reason:  # the engine by itself says the same, and begins nothing
        gas = CaseGas.from_case(made, start=False)
        with pytest.raises(InputError, match=reason):
            gas.simulation()


def test_a_flow_too_fast_for_theory_to_follow_collides_as_in_its_steady_state(toml):
    """Times count in units of 1 / rate there, so collisions in a given time go with the rate.

    At 1e4 theory follows the heating, too, and the anisotropy of the temperature, which takes 1 % of the collisions.
    """

    def expected(rate: str) -> float:
        overrides = [f"box.shear_rate={rate}", "run.t_end=1.0", "run.collisions_per_disk="]
        return RunEstimate.of(CaseGas.from_case(case_file.read(toml, overrides).case)).collisions

    assert expected("1e10") == pytest.approx(1e2 * expected("1e8"), rel=1e-9)
    assert expected("1e10") == pytest.approx(1e6 * expected("1e4"), rel=0.02)
