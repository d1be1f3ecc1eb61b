# %% [markdown]
# # From a film to coefficients
#
# A camera sees coins collide on a table. Here the program makes the film itself, with known coefficients: e_n = 0.87,
# e_t = -0.88, mu = 0.21. The table of tracks has a line for each coin in each frame.

# %%
from pathlib import Path

import ifrdem
from ifrdem import fit
from ifrdem.fit import impacts
from ifrdem.fit.tracks import read
from ifrdem.validation import fit_video

fit_video.main(Path("."))
print(*Path("tracks.csv").read_text().splitlines()[1:4], sep="\n")

# %% [markdown]
# `impacts.find` fits the flights before and after each impact. Coins slow down on the table; how much, it estimates
# from all flights.

# %%
coin = ifrdem.coins["1 pta"]
found = impacts.find(read(Path("tracks.csv")), fit.Disk(mass=coin.mass, radius=coin.radius, k=coin.k))
Path("hits.csv").write_text(impacts.csv(found.pairs))
print(len(found.pairs["nx"]), "impacts")

# %% [markdown]
# The fit takes the errors of all values into account, and compares laws. AIC is lowest for the law that the data
# prefer.

# %%
result = fit.fit(fit.read(Path("hits.csv")), model=["ifr-percussion", "walton"])
print(fit.table(result))
