"""Sections of a case on collisions: the laws of materials and of pairs of materials.

The sections of laws by name are made of what their classes say (`CollisionLaw.keys`).
"""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ConfigDict, Discriminator, Tag, create_model
from pydantic.fields import FieldInfo

from ..errors import there_are
from ..model.laws import files as law_files
from ..model.laws.coin_table import coins
from ..model.laws.ifr import REQUIRED_COEFFICIENTS, IFRLaw
from ..model.laws.law import CollisionLaw, Key
from ..model.laws.records import LAWS
from ..model.laws.table import KEYS as TABLE_KEYS
from ..model.laws.table import TableLaw
from ..tools.values import Number, Positive
from .section import Name, Section, exclusive_with, field, refusal


def _field(key: Key, default: Any = ...) -> Any:
    """The field of a key: its example, its default, its text."""
    return field(key.example, default, description=key.text)


def _type(key: Key) -> Any:
    """The type of a key: a number within its range, one of its choices, or any text."""
    if isinstance(key.allowed, type):
        return key.allowed
    return Annotated[float, key.allowed] if isinstance(key.allowed, Number) else Literal[key.allowed]


def _typed(key: Key) -> Any:
    """Type, example and text of a key that several sections have; `Section.about` finds them inside of the type."""
    return Annotated[_type(key), _field(key)]


if TYPE_CHECKING:
    NormalRestitution: TypeAlias = float
    TangentialRestitution: TypeAlias = float
    Friction: TypeAlias = float
    RollingFriction: TypeAlias = float
else:
    NormalRestitution, TangentialRestitution, Friction = (
        _typed(IFRLaw.keys[name]) for name in ("e_n", "e_t", "mu")
    )
    RollingFriction = _type(IFRLaw.keys["rho"])


def _known_coin(name: str) -> str:
    if name in coins:
        return name
    raise refusal(f"no such coin{there_are(name, coins)}", "unknown_name")


CoinName = Annotated[Name, AfterValidator(_known_coin)]


Correlation = Annotated[float, Number(-1.0, 1.0, "a number from -1 to 1")]
_ROUNDED = 1e-4
"""Most that rounded correlations may be beyond those of a covariance matrix."""


class LawSection(Section):
    """Coefficients of a law of collisions."""

    kind_key: ClassVar[str] = "law"

    errors: dict[str, Positive] | None = field({"e_n": 0.002, "mu": 0.001}, None)
    """Standard errors of coefficients [table], such as those of a fit: `ifrdem study --coefficients` draws from them."""
    correlations: dict[str, dict[str, Correlation]] | None = field({"e_n": {"mu": 0.3}}, None)
    """Correlations of these errors [table]: correlations.e_n.mu is that of e_n and mu, each pair once; 0 without it."""

    if TYPE_CHECKING:
        law: str

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes, errors of what is no coefficient included."""
        errors, tables = data.get("errors"), data.get("correlations")
        errors, tables = (each if isinstance(each, dict) else {} for each in (errors, tables))
        known = _numbers(cls, data)
        found = super().problems(data) + [
            f"errors.{name}: is no coefficient{there_are(name, known)}"
            for name in errors
            if name not in known
        ]
        pairs = [
            (a, b, value) for a, each in tables.items() if isinstance(each, dict) for b, value in each.items()
        ]
        wrong = [
            f"correlations.{a}.{b}: must be of two coefficients of errors, {', '.join(errors) or 'which are missing'}"
            for a, b, _ in pairs
            if a == b or not {a, b} <= {*errors}
        ]
        wrong += [
            f"correlations.{b}.{a}: is given as correlations.{a}.{b}, too"
            for (a, b, _), (c, d, _) in itertools.combinations(pairs, 2)
            if (a, b) == (d, c)
        ]
        if not wrong and pairs and all(isinstance(value, int | float) for *_, value in pairs):
            nested = {a: each for a, each in tables.items() if isinstance(each, dict)}
            least = float(np.linalg.eigvalsh(_correlation([*errors], nested))[0])
            if not least > -_ROUNDED:
                wrong.append("correlations: no covariance matrix has these; they are too large together")
        return found + wrong

    def coefficient(self, name: str) -> float:
        """The value of a coefficient."""
        return float(getattr(self, name))

    @property
    def covariance(self) -> tuple[tuple[str, ...], NDArray[np.float64]]:
        """Names (p,) of the coefficients that have errors, and their covariance matrix (p, p)."""
        errors = self.errors or {}
        sizes = np.array([*errors.values()])
        return (*errors,), _correlation([*errors], self.correlations or {}) * np.outer(sizes, sizes)

    def made(self, k: float) -> CollisionLaw:
        """The law of disks whose mean shape number is k."""
        named = LAWS[self.law]
        shape = {"k": k} if named.kind.takes_k and named.make is named.kind else {}
        return named.make(**{key: getattr(self, key) for key in named.keys}, **shape)


def _numbers(cls: type[Section], data: Mapping[str, Any]) -> list[str]:
    """Names of the coefficients of a section: numbers of its law, or of a custom law those that are given."""
    name = data.get("law", IFR_LAWS[0])
    if isinstance(name, str) and name in LAWS:
        return [key for key, each in LAWS[name].keys.items() if isinstance(each.allowed, Number)]
    return [key for key in data if key not in cls.model_fields]


def _correlation(names: Sequence[str], tables: Mapping[str, Mapping[str, float]]) -> NDArray[np.float64]:
    """The correlation matrix (p, p) of names."""
    found = np.eye(len(names))
    for a, each in tables.items():
        for b, value in each.items():
            i, j = names.index(a), names.index(b)
            found[i, j] = found[j, i] = value
    return found


class MaterialSection(LawSection):
    """Collisions of two disks of one material."""

    name: Name = field("aluminium")
    """Name that species and pairs use [text]."""


class PairSection(LawSection):
    """Collisions of two different materials, those of walls too. No coefficient is ever guessed from two materials."""

    materials: list[Name] = field(["bronze-aluminium", "aluminium"], min_length=2, max_length=2)
    """Names of the two materials [text], of disks or of disks and a wall."""


def _shown_keys() -> Iterator[str]:
    for name, named in LAWS.items():
        required = ", ".join(key for key in named.keys if key not in named.defaults)
        yield f'"{name}" ({"; ".join(filter(None, (required, ", ".join(named.defaults))))})'


LAW = (
    f'law of collisions: {", ".join(_shown_keys())}, or "FILE.py:CLASS", a custom law in a file (path from the case '
    "file), whose code is executed, with its coefficients as keys"
)

IFR_LAWS = tuple(name for name, named in LAWS.items() if named.kind is IFRLaw)
"""Those laws that are an `IFRLaw`; the first one is the default."""


class FileKeys(Section):
    """A custom law in a file of Python, with its coefficients as further keys."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="allow")
    kind_name: ClassVar[str] = law_files.FORM

    law: str = field("mylaw.py:Viscoelastic", description=LAW)

    @property
    def values(self) -> dict[str, Any]:
        """The given values of coefficients, by name."""
        return dict(self.__pydantic_extra__ or {})


class TableKeys(Section):
    """A law by a table in a file, with its path from the case file."""

    kind_name: ClassVar[str] = TableLaw.name_in_cases

    law: Literal["table"] = field("table", description=LAW)
    file: str = _field(TABLE_KEYS["file"])
    e_n: NormalRestitution | None = _field(TABLE_KEYS["e_n"], None)

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes: an error of e_n, which stands in the file."""
        wrong = isinstance(data.get("errors"), dict) and "e_n" in data["errors"] and "e_n" not in data
        return super().problems(data) + ["errors.e_n: requires e_n, which is in the file"] * wrong

    def read(self, folder: Path, k: float) -> TableLaw:
        """The law of disks whose mean shape number is k; InputError with the line if the file is wrong."""
        return TableLaw.read(folder / self.file, e_n=self.e_n, k=k)


class IFRMaterial(MaterialSection):
    """The IFR law, independent friction-restitution, by its coefficients or the name of one of its coins."""

    choices: ClassVar[tuple[str, ...]] = ("Either e_n, e_t and mu, or coin",)

    law: Literal["ifr"] = field("ifr", "ifr", description=LAW)
    coin: CoinName | None = field("1 pta", None)
    """Coin of the paper's Table II [text] whose e_n, e_t and mu are taken."""
    e_n: NormalRestitution | None = None
    e_t: TangentialRestitution | None = None
    mu: Friction | None = None
    sticking: Literal["percussion_center", "contact_point"] = _field(
        IFRLaw.keys["sticking"], "percussion_center"
    )
    rho: RollingFriction = _field(IFRLaw.keys["rho"], 0.0)

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes: coefficients given with a coin, or missing without one."""
        missing = [key for key in REQUIRED_COEFFICIENTS if key not in data and "coin" not in data]
        problems = super().problems(data) + exclusive_with(data, "coin", *REQUIRED_COEFFICIENTS, "errors")
        return [*problems, f"missing: {', '.join(missing)}, or coin"] if missing else problems

    def made(self, k: float) -> IFRLaw:
        """The law of disks whose mean shape number is k."""
        given = self if self.coin is None else coins[self.coin].law
        numbers: dict[str, Any] = {key: getattr(given, key) for key in REQUIRED_COEFFICIENTS}
        return IFRLaw(**numbers, sticking=self.sticking, rho=self.rho, k=k)


class FileMaterial(MaterialSection, FileKeys):
    """A custom law in a file of Python, with its coefficients as further keys."""


class TableMaterial(MaterialSection, TableKeys):  # type: ignore[misc]  # one law of all
    """A law by a table of P_t / P_n against the slip, in a file; e_n may depend on the speed."""


class TablePair(PairSection, TableKeys):  # type: ignore[misc]
    """A law by a table of P_t / P_n against the slip, in a file; e_n may depend on the speed."""


class FilePair(PairSection, FileKeys):
    """A custom law in a file of Python, with its coefficients as further keys."""


def law(section: Any) -> Any:
    """The law of a section, of which "ifr" is the default; pydantic's messages have this function's name as the key."""
    found = section.get("law", "ifr") if isinstance(section, dict) else getattr(section, "law", None)
    return law_files.FORM if law_files.is_reference(found) else found


def _sections(base: type[LawSection], *own: type[LawSection]) -> dict[str, type[LawSection]]:
    """The sections of all laws by name: those that are given, and of other laws one made of the keys of the law."""
    found = {each.kind_name or IFR_LAWS[0]: each for each in own}
    for name, named in LAWS.items():
        if name not in found:
            fields: dict[str, tuple[Any, FieldInfo]] = {
                "law": (
                    Literal[name],
                    field(name, *(IFR_LAWS[:1] if name == IFR_LAWS[0] else ()), description=LAW),
                )
            }
            for key, each in named.keys.items():
                fields[key] = (_type(each), _field(each, named.defaults.get(key, ...)))
            title = f"{name.title()}{base.__name__}"
            found[name] = create_model(
                title, __base__=base, __module__=__name__, __doc__=named.about, **fields
            )  # type: ignore[call-overload]
            found[name].is_generated = True
            globals()[title] = found[name]  # where pickle looks for it
    return {name: found[name] for name in (*LAWS, law_files.FORM)}


if TYPE_CHECKING:
    Material = MaterialSection
    PairOfMaterials = PairSection
else:
    Material, PairOfMaterials = (
        Annotated[
            functools.reduce(operator.or_, (Annotated[each, Tag(name)] for name, each in kinds)),
            Discriminator(law),
        ]
        for kinds in (
            _sections(MaterialSection, IFRMaterial, TableMaterial, FileMaterial).items(),
            _sections(PairSection, TablePair, FilePair).items(),
        )
    )
