# %% [markdown]
# # A first gas
#
# 2,000 aluminium coins slide without friction on a table that has no edges, and lose energy in every collision.

# %%
import ifrdem

coin = ifrdem.coins["1 pta"]
disks = ifrdem.Disks(2000, mass=coin.mass, radius=coin.radius, k=coin.k)
box = ifrdem.Box.from_packing_fraction(disks.radius, 0.25)
position = ifrdem.initial.random_positions(box, disks.radius, seed=1)
velocity = ifrdem.initial.maxwellian(disks.mass, speed_rms=1.0, seed=1)
gas = ifrdem.Simulation(disks, box, coin.law, ifrdem.State(position, velocity, spin=[0.0] * disks.n))
gas

# %% [markdown]
# An object shows itself as a table with a thumbnail. `run` shows a bar, which says "compiling" for the first seconds
# of a first run on a machine.

# %%
gas.run(collisions_per_disk=30)
gas.collisions, gas.dissipated_energy, gas.measure().temperature

# %% [markdown]
# `plot` returns axes of Matplotlib. Colours are spin, speed, direction, temperature, radius, material, species and
# collisions: disks that move together are of one colour here.

# %%
axes = gas.plot(color="direction")
_ = axes.set_title("coins after 30 collisions each")
