# %% [markdown]
# # Walls and heat
#
# Smooth elastic disks between a wall at T = 4 and one at T = 1. Disks leave a thermal wall as if they came from a gas
# of its temperature, so heat flows through the gas. This is a smaller version of the shipped case `thermal_walls`,
# which also stores each collision: the heat that collisions carry needs them.

# %%
import ifrdem

case = ifrdem.Case.read("thermal_walls")
case.box.lengths = [40.0, 20.0]
case.wall[1].point = [40.0, 0.0]
case.species[0].number = 80
case.run.t_end = 1000.0
case.output.histories_all = True
run = case.run_to("heat.h5", force=True, picture=False)
run

# %% [markdown]
# What each wall has given to the disks grows evenly once the gas is steady. One wall gives what the other takes.

# %%
from matplotlib import pyplot

axes = pyplot.figure(layout="constrained").subplots()
time, heat = run.series.time, run.series["walls_heat"]
for column, name, line in zip(heat.T, ("hot wall", "cold wall"), ("-", "--"), strict=False):
    axes.plot(time, column, line, label=name)
axes.set(xlabel="time", ylabel="heat given to the disks")
_ = axes.legend()

# %% [markdown]
# In a steady state the heat flux q_x is the same in every bin, and equal to the heat of the hot wall for each time and
# length of the wall. Errors are standard errors over blocks of frames.

# %%
from ifrdem import analysis

found = analysis.profiles(run, "x", 8, frames=range(len(run) // 4, len(run)))
late = time > time[-1] / 4
flux = (heat[late, 0][-1] - heat[late, 0][0]) / (time[late][-1] - time[late][0]) / case.box.lengths[1]
print("q_x of the bins:", found.mean.heat_flux[:, 0].round(3))
print("errors:         ", found.error.heat_flux[:, 0].round(3))
print("of the hot wall:", round(flux, 3))

# %%
_ = run.plot("profiles")
