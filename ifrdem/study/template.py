"""The study file that `ifrdem new study` writes."""

TEXT = """\
# Haff's law and the ratio of temperatures of a cooling gas, for restitution and friction.
# ifrdem study FILE --dry-run says what it takes; ifrdem study FILE does it; again, it goes on where it was stopped.

# The base case: a case file (path from this file), or the name of a shipped case.
case = "cooling"
# Changes of it for every run, as `ifrdem run --set` takes them.
set = ["species[0].number=2000", "run.collisions_per_disk=20", "output.histories="]

# Every combination of these values, and every seed, is a run. A key is spelled as for --set.
[sweep]
"material[0].e_n" = [0.7, 0.8, 0.9]
"material[0].mu" = [0.05, 0.21, 0.5]
# "material[0].mu" = { from = 0.0, to = 0.5, number = 6 }                          # evenly
# "box.packing_fraction" = { from = 0.01, to = 0.5, number = 5, spacing = "log" }  # at a constant ratio

# Keys that vary together, as one axis: as many values each.
# [[zip]]
# "species[0].number" = [500, 2000, 8000]
# "species[0].speed_rms" = [1.0, 2.0, 4.0]

[ensemble]
# A number of seeds, from run.seed of the case on, or a list: [1, 2, 5].
seeds = 20

[output]
# Rows of the time series after the first, evenly in what ends the run, or "log".
series = 50
# series_spacing = "log"
# Analyses of every run, as in `ifrdem analyse`; those of frames (velocity, g, S, fields, clusters, psi6) at these
# collisions per disk (times, where the run ends at a time).
# analyses = ["velocity", "g"]
# analyses_at = [5.0, 10.0, 20.0]
# Keep the trajectory of every run.
# trajectories = true

[cluster]
# Nothing: a process for each core of this machine. Else one of these three.
# workers = 4
# scheduler = "tcp://host:8786"        # of Dask
# kind = "slurm"                       # or pbs, sge, lsf: jobs of a batch system, by dask-jobqueue
# jobs = 10
# options = { cores = 16, memory = "16 GB", walltime = "02:00:00", queue = "short" }
"""
