"""Files of measured impacts: values read, and all mistakes named at once with their lines."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from ifrdem import fit
from ifrdem.errors import InputError, on_command_line
from ifrdem.fit.data import COLUMNS, Data

GOOD = "psi,delta_2\n10,4\n50,13\n"


def read(folder: Path, text: str, errors: dict[str, float] | None = None) -> Data:
    path = folder / "data.csv"
    path.write_text(text, encoding="utf-8")
    return fit.read(path, {"angles": 0.7} if errors is None else errors)


def problems_of_table(folder: Path, text: str, errors: dict[str, float] | None = None) -> list[str]:
    with pytest.raises(InputError) as found:
        read(folder, text, errors)
    lines = str(found.value).splitlines()
    assert all(line.startswith(str(folder / "data.csv")) for line in lines)
    return [line.removeprefix(f"{folder / 'data.csv'}: ") for line in lines]


def test_columns_comments_and_errors_are_read(tmp_path: Path) -> None:
    text = (
        "# coins\n\npsi, delta_2 ,delta_2_error,Rw_2\n10,4,0.5,0.2\n# a comment between\n50.5,-13,0.6,0.4\n"
    )
    data = read(tmp_path, text, {"angles": 0.7, "Rw_2": 0.02})
    np.testing.assert_array_equal(data.psi, [10.0, 50.5])
    np.testing.assert_array_equal(data.measured["delta_2"], [4.0, -13.0])
    np.testing.assert_array_equal(data.errors["delta_2"], [0.5, 0.6])  # the column comes first
    np.testing.assert_array_equal(data.errors["psi"], [0.7, 0.7])
    np.testing.assert_array_equal(data.errors["Rw_2"], [0.02, 0.02])
    assert data.names == ("delta_2", "Rw_2")
    assert data.line is not None
    assert list(data.line) == [4, 6]


def test_error_by_name_comes_before_that_of_all_angles(tmp_path: Path) -> None:
    data = read(tmp_path, GOOD, {"angles": 0.7, "psi": 0.3})
    assert (data.errors["psi"][0], data.errors["delta_2"][0]) == (0.3, 0.7)


@pytest.mark.parametrize(
    ("column", "name"),
    [
        ("Delta2", "delta_2"),
        ("delta 2 (deg)", "delta_2"),
        ("delta_2 [degrees]", "delta_2"),
        ("δ2", "delta_2"),
        ("delta-1", "delta_1"),
        ("R2w2/v0", "Rw_2"),
        ("R_2 omega_2 / v_o", "Rw_2"),
        ("RW_2", "Rw_2"),
        ("sqrt(d2/d1)", "sqrt_d2_d1"),
        ("(d2/d1)^(1/2)", "sqrt_d2_d1"),
        ("e_t*", "e_t_apparent"),
        ("et_star", "e_t_apparent"),
    ],
)
def test_obvious_spellings_are_understood(tmp_path: Path, column: str, name: str) -> None:
    data = read(tmp_path, f"PSI_deg,{column},sigma_psi\n10,4,1\n", {"angles": 0.7, name: 0.1})
    assert data.names == (name,)
    assert data.errors["psi"][0] == 1.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", r"is empty"),
        ("# only a comment\n", r"is empty"),
        ("psi,delta_2\n", r"no line of values follows"),
        ("10,4\n50,13\n", r"line 1: there is no header"),
        (
            "psi;delta_2\n10;4\n",
            r"line 1: columns must be separated by ','.*delimiter = ';'",
        ),
        (
            "psi,delta_3\n10,4\n",
            r"line 1: unknown column 'delta_3' \(did you mean 'delta_[12]'\?\); columns = {'delta_",
        ),
        ("phi,delta_2\n10,4\n", r"missing column psi; there are delta_2"),
        ("psi,delta_2_eror\n10,4\n", r"did you mean 'delta_2_error'"),
        ("psi [cm],delta_2\n0.1,4\n", r"column 'psi \[cm\]': psi is an angle, not in cm"),
        ("psi,Rw_2 (deg)\n10,4\n", r"Rw_2 is a pure number"),
        ("psi,psi_error\n10,4\n", r"missing column delta_2, or another"),
        ("delta_2,Rw_2\n10,4\n", r"missing column psi; there are delta_2, Rw_2"),
        (
            "psi,delta_2,vx_1\n10,4,1\n",
            r"\(psi, delta_2\) and of whole collisions \(vx_1\)",
        ),
        (
            "psi,delta_2,delta2\n10,4,4\n",
            r"column 'delta_2' is given twice, by 'delta_2' and 'delta2'; .*'delta2'.* chooses",
        ),
        ("psi,delta_2,delta_1_error\n10,4,1\n", r"column 'delta_1_error' requires a column 'delta_1'"),
    ],
)
def test_wrong_columns_are_refused(tmp_path: Path, text: str, says: str) -> None:
    (line,) = problems_of_table(tmp_path, text)
    assert re.search(says, line)


def test_every_bad_row_is_named_by_its_line_at_once(tmp_path: Path) -> None:
    text = "# comment\npsi,delta_2,delta_2_error\n10,4,0.5\n-1,4,0.5\n20,4\n30,four,0.5\n60,3,0\n70,inf,-1\n"
    assert [line.split(": ", 2)[:2] for line in problems_of_table(tmp_path, text)] == [
        ["line 5", "2 values"],
        ["line 6", "delta_2 = four"],
        ["line 8", "delta_2 = inf"],
    ]
    text = "# comment\npsi,delta_2,delta_2_error\n10,4,0.5\n-1,4,0.5\n90,4,0.5\n50,95,0.5\n60,13,0\n70,1,-1\n"
    assert [line.split(": ", 2)[:2] for line in problems_of_table(tmp_path, text)] == [
        ["line 4", "psi = -1"],
        ["line 5", "psi = 90"],
        ["line 6", "delta_2 = 95"],
        ["line 7", "error of delta_2 = 0"],
        ["line 8", "error of delta_2 = -1"],
    ]


def test_missing_values_are_left_out_and_counted(tmp_path: Path) -> None:
    data = read(tmp_path, "psi,delta_1,delta_2\n10,,4\nnan,80,3\n50,NA,-\n60,85,13\n")
    np.testing.assert_array_equal(data.psi, [10.0, 60.0])
    np.testing.assert_array_equal(data.measured["delta_1"], [np.nan, 85.0])
    assert data.notes == (
        "4 values are missing and left out",
        "2 lines without psi or without a value after the impact are left out: 3, 4",
    )


def test_other_names_units_delimiters_and_decimals_are_read(tmp_path: Path) -> None:
    path = tmp_path / "lab.csv"
    path.write_text("# film 3\nnr;impact angle;delta_2 (rad)\n1;10,5;0,1\n2;50;0,2\n", encoding="utf-8")
    form = fit.TableFormat({"psi": "impact angle"}, {}, {}, ";", ",")
    data = fit.read(path, {"angles": 0.7}, form=form)
    np.testing.assert_array_equal(data.psi, [10.5, 50.0])
    np.testing.assert_allclose(data.measured["delta_2"], np.degrees([0.1, 0.2]), rtol=1e-15)
    assert data.notes == ("columns not used: nr",)
    with pytest.raises(InputError, match=r"column psi='impact angel': .*did you mean 'impact angle'"):
        fit.read(path, {"angles": 0.7}, form=fit.TableFormat({"psi": "impact angel"}, {}, {}, ";", ","))
    with pytest.raises(InputError, match=r"unit psi=dge: .*did you mean 'deg'"):
        fit.read(
            path, {"angles": 0.7}, form=fit.TableFormat({"psi": "impact angle"}, {"psi": "dge"}, {}, ";", ",")
        )


def test_missing_errors_are_named_for_each_quantity(tmp_path: Path) -> None:
    lines = problems_of_table(tmp_path, "psi,delta_2,Rw_2\n10,4,0.2\n", {})
    assert [line.split(":")[0] for line in lines] == ["psi", "delta_2", "Rw_2"]
    assert "give a column Rw_2_error, errors['Rw_2']" in lines[2]
    assert "errors['angles']" in lines[0]
    with on_command_line():
        lines = problems_of_table(tmp_path, "psi,delta_2,Rw_2\n10,4,0.2\n", {})
    assert "give a column Rw_2_error, --error Rw_2=VALUE" in lines[2]
    assert "--error DEGREES for all angles" in lines[0]
    (line,) = problems_of_table(tmp_path, GOOD, {"angles": 0.7, "delta_1": 0.5})
    assert "the file has no column delta_1 (did you mean 'delta_2'?)" in line


def test_missing_file_names_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "coins.csv").write_text(GOOD, encoding="utf-8")
    with pytest.raises(InputError, match=r"coin\.csv: there is no such file \(did you mean 'coins\.csv'\?\)"):
        fit.read(tmp_path / "coin.csv", {"angles": 0.7})
    with pytest.raises(
        InputError, match=r"hits\.csv: there is no such file$"
    ):  # of coins only .csv is like it
        fit.read(tmp_path / "hits.csv", {"angles": 0.7})


def test_arrays_are_checked_as_files_are() -> None:
    psi = np.array([10.0, 95.0])
    with pytest.raises(InputError, match=r"data: impact 2: psi = 95"):
        Data(psi=psi, measured={"delta_2": np.array([4.0, 5.0])}, errors={"psi": 1.0, "delta_2": 1.0})
    with pytest.raises(InputError, match=r"delta_2 has shape \(3,\): must be \(2,\)"):
        Data(psi=psi, measured={"delta_2": np.zeros(3)}, errors={"psi": 1.0, "delta_2": 1.0})
    with pytest.raises(InputError, match=r"delta2: no such quantity \(did you mean 'delta_2'\?\)"):
        Data(psi=psi, measured={"delta2": psi}, errors={"psi": 1.0})
    with pytest.raises(InputError, match=r"delta_2: missing from errors"):
        Data(psi=psi, measured={"delta_2": psi}, errors={"psi": 1.0})
    with pytest.raises(InputError, match=r"key of measured = 0: must be"):
        Data(psi=psi, measured={0: psi}, errors={"psi": 1.0})  # type: ignore[dict-item]


def test_example_says_that_it_is_synthetic_and_holds_its_coefficients(tmp_path: Path) -> None:
    text = fit.example()
    assert text.startswith("# SYNTHETIC, not measured")
    assert "e_n = 0.87, e_t = -0.88, mu = 0.21" in text.splitlines()[0]
    fitted = fit.fit(read(tmp_path, text), M=1.0, model=["ifr-percussion"])
    found = fitted.laws["ifr-percussion"].estimates
    for name, true in (("e_n", 0.87), ("e_t", -0.88), ("mu", 0.21)):
        assert abs(found[name].value - true) < 3.0 * found[name].standard_error


def test_help_lists_every_column() -> None:
    from ifrdem.cli import fit as fit_options

    listed = re.findall(r"^  (\w+) {2,}", fit_options.FORMAT, flags=re.MULTILINE)[: len(COLUMNS)]
    assert sorted(listed) == sorted(COLUMNS)
