"""Sections of a case on collisions: the laws of materials and of pairs of materials."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Tag

from ..errors import there_are
from ..model.laws import files as law_files
from ..model.laws.coin_table import coins
from ..model.laws.ifr import REQUIRED_COEFFICIENTS, IFRLaw, rough_disks, smooth_disks
from ..model.laws.viscoelastic import Viscoelastic
from ..model.laws.walton import Walton
from ..tools import values
from .section import Name, Section, exclusive_with, field, refusal

# Example and text sit inside the types, because several sections have the key; `Section.about` finds them there.
NormalRestitution = Annotated[
    float, values.E_N, field(0.87, description="normal restitution e_n [1], 0 to 1 (elastic)")
]
TANGENTIAL = (
    "tangential restitution e_t [1], -1 (smooth but for friction) to 1; with percussion-centre sticking, "
    "homogeneous disks never gain energy up to -0.5"
)
TangentialRestitution = Annotated[float, values.E_T, field(-0.88, description=TANGENTIAL)]
Friction = Annotated[float, values.MU, field(0.21, description="sliding friction mu [1], 0 or more")]
STICKING = (
    'what stops slipping in a sticking collision: "percussion_center" (Eq. 15, the paper\'s choice) or '
    '"contact_point" (Eq. 12)'
)
Sticking = Annotated[
    Literal["percussion_center", "contact_point"], field("percussion_center", description=STICKING)
]
RollingFriction = Annotated[
    float, values.NON_NEGATIVE, field(0.0, description="rolling friction rho [m], 0 or more")
]


def _known_coin(name: str) -> str:
    if name in coins:
        return name
    raise refusal(f"no such coin{there_are(name, coins)}", "unknown_name")


CoinName = Annotated[Name, AfterValidator(_known_coin)]


class MaterialSection(Section):
    """Collisions of two disks of one material."""

    kind_key: ClassVar[str] = "law"

    name: Name = field("aluminium")
    """Name that species and pairs use [text]."""


class PairSection(Section):
    """Collisions of two different materials, those of walls too. No coefficient is ever guessed from two materials."""

    kind_key: ClassVar[str] = "law"

    materials: list[Name] = field(["bronze-aluminium", "aluminium"], min_length=2, max_length=2)
    """Names of the two materials [text], of disks or of disks and a wall."""


LAW = (
    'law of collisions: "ifr" (e_n, e_t, mu), "walton" (e_n, beta_0, mu), "viscoelastic" (A, Y; e_t, mu), "rough" '
    '(e_n, beta), "smooth" (e_n), or "FILE.py:CLASS", a custom law in a file (path from the case file), whose code is '
    "executed, with its coefficients as keys"
)

IFR_LAWS = ("ifr", "rough", "smooth")
"""Those laws that are an `IFRLaw`; the first one is the default."""


class IFRPair(PairSection):
    """The IFR law, independent friction-restitution."""

    law: Literal["ifr"] = field("ifr", "ifr", description=LAW)
    e_n: NormalRestitution
    e_t: TangentialRestitution
    mu: Friction
    sticking: Sticking = "percussion_center"
    rho: RollingFriction = 0.0

    def made(self, k: float) -> IFRLaw:
        """The law of disks whose mean shape number is k."""
        return IFRLaw(e_n=self.e_n, e_t=self.e_t, mu=self.mu, sticking=self.sticking, rho=self.rho, k=k)


class WaltonKeys(Section):
    """Walton's law: constant restitution of the slip up to Coulomb's limit."""

    law: Literal["walton"] = field("walton", description=LAW)
    e_n: NormalRestitution
    beta_0: values.TangentialRestitution = field(0.4)
    """Tangential restitution of impacts that stick [1], -1 (smooth) to 1."""
    mu: Friction

    def made(self, k: float) -> Walton:
        """The law."""
        return Walton(e_n=self.e_n, beta_0=self.beta_0, mu=self.mu)


class ViscoelasticKeys(Section):
    """Viscoelastic spheres, e_n by the speed of impact, with the friction of the IFR law."""

    law: Literal["viscoelastic"] = field("viscoelastic", description=LAW)
    A: values.NonNegative = field(1e-5)
    """Dissipative time of the material [s]."""
    Y: values.Positive = field(1e9)
    """Young's modulus over 1 - nu^2 [Pa]."""
    e_t: TangentialRestitution = -1.0
    mu: Friction = 0.0
    sticking: Sticking = "percussion_center"
    rho: RollingFriction = 0.0

    def made(self, k: float) -> Viscoelastic:
        """The law of disks whose mean shape number is k."""
        return Viscoelastic(
            A=self.A, Y=self.Y, e_t=self.e_t, mu=self.mu, sticking=self.sticking, rho=self.rho, k=k
        )


class RoughKeys(Section):
    """Rough disks of constant normal and tangential restitution, without friction."""

    law: Literal["rough"] = field("rough", description=LAW)
    e_n: NormalRestitution
    beta: values.TangentialRestitution = field(0.5)
    """Tangential restitution of the slip [1], -1 (smooth) to 1 (perfectly rough)."""

    def made(self, k: float) -> IFRLaw:
        """The law."""
        return rough_disks(self.e_n, self.beta)


class SmoothKeys(Section):
    """Smooth disks, normal restitution only."""

    law: Literal["smooth"] = field("smooth", description=LAW)
    e_n: NormalRestitution

    def made(self, k: float) -> IFRLaw:
        """The law."""
        return smooth_disks(self.e_n)


class FileKeys(Section):
    """A custom law in a file of Python, with its coefficients as further keys."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="allow")
    kind_name: ClassVar[str] = law_files.FORM

    law: str = field("mylaw.py:Viscoelastic", description=LAW)

    @property
    def values(self) -> dict[str, Any]:
        """The given values of coefficients, by name."""
        return dict(self.__pydantic_extra__ or {})


class IFRMaterial(MaterialSection):
    """The IFR law, independent friction-restitution, by its coefficients or the name of one of its coins."""

    choices: ClassVar[tuple[str, ...]] = ("Either e_n, e_t and mu, or coin",)

    law: Literal["ifr"] = field("ifr", "ifr", description=LAW)
    coin: CoinName | None = field("1 pta", None)
    """Take e_n, e_t, mu of this coin of the paper's Table II [text], for instance."""
    e_n: NormalRestitution | None = None
    e_t: TangentialRestitution | None = None
    mu: Friction | None = None
    sticking: Sticking = "percussion_center"
    rho: RollingFriction = 0.0

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes: coefficients given with a coin, or missing without one."""
        missing = [key for key in REQUIRED_COEFFICIENTS if key not in data and "coin" not in data]
        problems = exclusive_with(data, "coin", *REQUIRED_COEFFICIENTS)
        return [*problems, f"missing: {', '.join(missing)}, or coin"] if missing else problems

    def made(self, k: float) -> IFRLaw:
        """The law of disks whose mean shape number is k."""
        given = self if self.coin is None else coins[self.coin].law
        numbers: dict[str, Any] = {key: getattr(given, key) for key in REQUIRED_COEFFICIENTS}
        return IFRLaw(**numbers, sticking=self.sticking, rho=self.rho, k=k)


class WaltonMaterial(MaterialSection, WaltonKeys):
    """Walton's law: constant restitution of the slip up to Coulomb's limit."""


class ViscoelasticMaterial(MaterialSection, ViscoelasticKeys):
    """Viscoelastic spheres, e_n by the speed of impact, with the friction of the IFR law."""


class RoughMaterial(MaterialSection, RoughKeys):
    """Rough disks of constant normal and tangential restitution, without friction."""


class SmoothMaterial(MaterialSection, SmoothKeys):
    """Smooth disks, normal restitution only."""


class FileMaterial(MaterialSection, FileKeys):
    """A custom law in a file of Python, with its coefficients as further keys."""


class FilePair(PairSection, FileKeys):
    """A custom law in a file of Python, with its coefficients as further keys."""


class WaltonPair(PairSection, WaltonKeys):
    """Walton's law: constant restitution of the slip up to Coulomb's limit."""


class ViscoelasticPair(PairSection, ViscoelasticKeys):
    """Viscoelastic spheres, e_n by the speed of impact, with the friction of the IFR law."""


class RoughPair(PairSection, RoughKeys):
    """Rough disks of constant normal and tangential restitution, without friction."""


class SmoothPair(PairSection, SmoothKeys):
    """Smooth disks, normal restitution only."""


def law(section: Any) -> Any:
    """The law of a section, of which "ifr" is the default; pydantic's messages have this function's name as the key."""
    found = section.get("law", "ifr") if isinstance(section, dict) else getattr(section, "law", None)
    return law_files.FORM if law_files.is_reference(found) else found


Material = Annotated[
    Annotated[IFRMaterial, Tag("ifr")] | Annotated[WaltonMaterial, Tag("walton")]
    | Annotated[ViscoelasticMaterial, Tag("viscoelastic")] | Annotated[RoughMaterial, Tag("rough")]
    | Annotated[SmoothMaterial, Tag("smooth")] | Annotated[FileMaterial, Tag(law_files.FORM)],
    Discriminator(law),
]  # fmt: skip
PairOfMaterials = Annotated[
    Annotated[IFRPair, Tag("ifr")] | Annotated[WaltonPair, Tag("walton")]
    | Annotated[ViscoelasticPair, Tag("viscoelastic")] | Annotated[RoughPair, Tag("rough")]
    | Annotated[SmoothPair, Tag("smooth")] | Annotated[FilePair, Tag(law_files.FORM)],
    Discriminator(law),
]  # fmt: skip
