# %% [markdown]
# # A study
#
# One case for three values of a coefficient, and four seeds each. `workers=0` runs them one after another in this
# process; without it they run on all cores, from a file as from a notebook.

# %%
import ifrdem

study = ifrdem.Study(
    "cooling",
    vary=["material[0].e_n=0.7,0.8,0.9"],
    set=["species[0].number=300", "run.collisions_per_disk=10"],
    seeds=4,
)
study

# %%
failed = study.run(workers=0)
failed

# %% [markdown]
# The results are a data set with means and standard errors over seeds, and kinetic theory.

# %%
data = study.dataset()
data.temperature_mean.isel(collisions_per_disk=-1).values

# %% [markdown]
# With results there, the study shows its first picture. `ifrdem plot cooling-study.nc theta --by e_n` draws others.

# %%
study
