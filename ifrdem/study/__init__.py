"""Studies: one case run for many values of its keys and many seeds, on all cores or on a cluster, as one data set."""
