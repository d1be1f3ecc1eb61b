# %% [markdown]
# # A custom law
#
# A law is a class, and it may stand in a cell or in a file. In this one, restitution falls with the speed of
# approach, as for viscoelastic spheres to lowest order.

# %%
import numpy as np
from ifrdem import ti

import ifrdem


class SpeedDependent(ifrdem.CollisionLaw):
    """e_n = 1 - c g_n^(1/5), smooth."""

    coefficients = ("c",)

    @staticmethod
    def collide(pair, law):
        e_n = ti.max(1.0 - law.c * pair.g_n**0.2, 0.0)
        return (1.0 + e_n) * pair.m_n * pair.g_n, 0.0, 0.0


# %% [markdown]
# It is not proved that this law never adds energy, so a simulation tries it on random pairs and would warn if one of
# them gained energy. For comparison, a gas with a constant e_n that loses as much at first.

# %%
disks = ifrdem.Disks(1000, mass=1.0, radius=0.5)
box = ifrdem.Box.from_packing_fraction(disks.radius, 0.1)
position = ifrdem.initial.random_positions(box, disks.radius, seed=1)
velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)


def temperatures(law):
    """Times and temperatures over 40 frames."""
    gas = ifrdem.Simulation(disks, box, law, ifrdem.State(position, velocity, np.zeros(disks.n)))
    rows = []
    gas.run(
        t_end=200.0,
        frames=40,
        frame_callbacks=[lambda state, now: rows.append((state.time, now.temperature))],
    )
    return np.array(rows).T


cooling = {"viscoelastic": temperatures(SpeedDependent(c=0.15))}
cooling["constant"] = temperatures(ifrdem.IFRLaw(e_n=0.86, e_t=-1.0, mu=0.0))

# %% [markdown]
# The viscoelastic gas cools more slowly the colder it is: $T \sim t^{-5/3}$ instead of $t^{-2}$.

# %%
from matplotlib import pyplot

axes = pyplot.figure(layout="constrained").subplots()
for (name, (t, T)), look in zip(cooling.items(), ("o-", "^--"), strict=True):
    axes.loglog(t[1:], T[1:], look, mfc="none", ms=4, label=name)
axes.set(xlabel="time $t$", ylabel="temperature $T$")
_ = axes.legend()
