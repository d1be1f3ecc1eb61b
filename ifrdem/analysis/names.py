"""Names of the analyses of a trajectory, and what is said of each. It imports nothing: `ifrdem --help` reads it."""

from typing import NamedTuple


class Analysis(NamedTuple):
    """Texts and options of an analysis.

    Attributes
    ----------
    title : str
        Its title in the results.
    text : str
        What it gives, in the help of `ifrdem analyse`.
    picture : str
        What its picture shows, in the help of `ifrdem plot`; empty if it has none.
    over_time : bool
        True for one of a whole run, False for one of single frames.
    options : tuple of str
        Options that only this one takes.
    """

    title: str
    text: str
    picture: str = ""
    over_time: bool = False
    options: tuple[str, ...] = ()


ANALYSES = {
    "velocity": Analysis(
        "velocities and spins: Sonine coefficients",
        "velocities and spins: Sonine coefficients",
        "distributions of velocities and spins, with Gaussians",
    ),
    "tail": Analysis(
        "tail of the distribution of speeds",
        "speeds to the largest, exp(-A c^nu) fitted",
        "distribution of speeds to the largest, with exp(-A c^nu) and a Gaussian",
    ),
    "rdf": Analysis(
        "pair correlation g(r)",
        "pair correlation g(r), its value at contact",
        "pair correlation g(r) and its contact value",
    ),
    "structure-factor": Analysis("structure factor S(k)", "structure factor S(k)", "structure factor S(k)"),
    "msd": Analysis(
        "mean-square displacement",
        "mean-square displacement, diffusion",
        "mean-square displacement and the diffusion coefficient",
        over_time=True,
    ),
    "vacf": Analysis(
        "velocity autocorrelation", "velocity autocorrelation", "velocity autocorrelation", over_time=True
    ),
    "profiles": Analysis(
        "averages in bins along an axis",
        "density, flow, T, stress and heat flux along --axis",
        "density, flow, temperatures, stress and heat flux along an axis, with errors",
        over_time=True,
        options=("axis", "bins", "windows", "phases"),
    ),
    "cycle": Analysis(
        "means at phases of the moving walls",
        "means of the series at phases of walls that move to and fro",
        "temperatures, centre of mass and regions at phases of walls that move to and fro",
        over_time=True,
    ),
    "fields": Analysis(
        "coarse-grained fields",
        "density, flow and temperature; --average over frames",
        "maps of density, flow and thermal temperature",
        options=("cells", "average"),
    ),
    "clusters": Analysis(
        "clusters", "sizes, the largest, radius of gyration", "the largest cluster in time, and cluster sizes"
    ),
    "psi6": Analysis("hexatic order psi_6", "hexatic order", "hexatic order of the disks"),
    "pressure": Analysis("pressure", "from impulses and from the rate of collisions", over_time=True),
    "stress": Analysis(
        "pressure tensor",
        "pressure tensor, friction and N_1 (output.stress)",
        "pressure tensor against time, and its kinetic and collisional part (output.stress)",
        over_time=True,
    ),
    "transport": Analysis(
        "transport coefficients by fluctuations",
        "viscosity, heat conductivity, diffusion (output.stress, heat_flux)",
        "viscosity, heat conductivity and diffusion by Green-Kubo and Helfand (output.stress, heat_flux)",
        over_time=True,
        options=("lag",),
    ),
    "cooling": Analysis(
        "Haff's law and the ratio of temperatures",
        "fits of Haff's law and of T_rot / T",
        "Haff's law, and the approach of T_rot / T to its end",
        over_time=True,
    ),
    "velocity-correlation": Analysis(
        "velocities of two disks at a distance",
        "of two disks along and across r, correlation length",
        "correlation of velocities along and across r, and the correlation length",
    ),
    "vorticity": Analysis(
        "spectrum of the velocity field",
        "spectrum of the velocity field, across and along k",
        "spectrum of the velocity field across and along k, and the wavelength of its maximum",
    ),
    "species": Analysis(
        "temperatures of species and their ratios",
        "temperatures of species, ratios, kinetic theory",
        "temperatures of each species, their ratios and theta, with kinetic theory",
        over_time=True,
    ),
    "impact": Analysis(
        "angles of impact and regimes",
        "angles of impact and regimes",
        "impact angles compared with molecular chaos, and regimes",
        over_time=True,
    ),
    "histograms": Analysis(
        "distributions of all collisions",
        "angles, normal speeds, free times of all collisions (output.histograms)",
        "angles, normal speeds and free times of all collisions, with equilibrium (output.histograms)",
        over_time=True,
    ),
}
"""The analyses by name, in the order in which they are done."""
OVER_TIME = tuple(name for name, each in ANALYSES.items() if each.over_time)
"""Analyses of a whole run."""
OF_FRAMES = tuple(name for name, each in ANALYSES.items() if not each.over_time)
"""Analyses of single frames."""
OPTIONS = {option: name for name, each in ANALYSES.items() for option in each.options}
"""Option -> the analysis that takes it."""
