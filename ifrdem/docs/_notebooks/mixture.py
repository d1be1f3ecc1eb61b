# %% [markdown]
# # A mixture
#
# Two species of smooth disks lose energy in collisions, and their temperatures do not stay equal: there is no
# equipartition. A case as an object, without a file:

# %%
import ifrdem

case = ifrdem.Case(
    run={"name": "mixture", "collisions_per_disk": 12.0, "units": "reduced"},
    box={"packing_fraction": 0.1},
    material=[{"name": "disks", "e_n": 0.8, "e_t": -1.0, "mu": 0.0}],
    species=[
        {"name": name, "material": "disks", "number": 1000, "mass": mass, "diameter": 1.0, "temperature": 1.0}
        for name, mass in (("light", 1.0), ("heavy", 8.0))
    ],
    output={"series": 24},
)
run = case.run_to("mixture.h5", force=True, picture=False)
run

# %% [markdown]
# The time series has the temperature of each species.

# %%
tau = run.series["collisions_per_disk"]
ratio = run.series["species_temperature/heavy"] / run.series["species_temperature/light"]
ratio[-1]

# %% [markdown]
# Kinetic theory begins with the same temperatures. Its ratio is constant in the end, when both species cool at the same
# rate.

# %%
from matplotlib import pyplot

from ifrdem import theory

mixture = theory.Mixture(
    mass=[1.0, 8.0],
    radius=[0.5, 0.5],
    law=ifrdem.IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0),
    packing_fraction=0.1,
    fraction=[0.5, 0.5],
)
(light, heavy), _ = theory.mixture_cooling_ratios(mixture)
axes = pyplot.figure(layout="constrained").subplots()
axes.plot(tau, ratio, "o-", mfc="none", label="gas")
axes.axhline(heavy / light, color="k", ls="--", label="kinetic theory, in the end")
axes.set(xlabel="collisions per disk", ylabel="$T$ of heavy / $T$ of light")
_ = axes.legend()

# %% [markdown]
# `ifrdem analyse mixture.h5 species` prints these ratios with errors; this is its picture.

# %%
_ = run.plot("species", over="tau")
