# %% [markdown]
# # From a trajectory to a figure
#
# A case runs from a notebook as from a shell; here a small version of the shipped case `cooling`.

# %%
from ifrdem.cli.main import main

changes = ["species[0].number=2000", "run.collisions_per_disk=40", "output.frames=40"]
status = main(
    [
        "--quiet",
        "run",
        "cooling",
        "--no-picture",
        "--force",
        *(word for one in changes for word in ("--set", one)),
    ]
)

# %%
import ifrdem

run = ifrdem.Trajectory("cooling.h5")
run

# %% [markdown]
# Every picture of `ifrdem plot --list` is drawn into given axes, for a figure of a paper.

# %%
from matplotlib import pyplot

figure = pyplot.figure(figsize=(10.0, 8.0), layout="constrained")
axes = figure.subplots(2, 2)
run.plot("temperatures", ax=axes[0, 0], over="tau")
run[-1].plot(ax=axes[0, 1], color="speed")
run.plot("rdf", ax=axes[1, 0])
run.plot("energy", ax=axes[1, 1])
_ = axes[0, 0].set_title("markers: the gas, dashed: kinetic theory", fontsize="medium")

# %% [markdown]
# Results of `ifrdem.analysis`, which takes arrays from anywhere, draw themselves too.

# %%
from ifrdem import analysis

frame = run[-1]
found = analysis.clusters(
    frame.position, run.box, radius=run.disks.radius, gap=0.1 * 2.0 * run.disks.radius[0]
)
found.plot()
found.largest, found.mean_size

# %% [markdown]
# Other programs take frames and files as they are.

# %%
import freud

rdf = freud.density.RDF(bins=50, r_max=0.1)
rdf.compute(frame)  # or (frame.box, frame.points)
universe = run.universe()  # of MDAnalysis
universe, universe.trajectory.n_frames
