"""The viewer of trajectories: a page for browsers, its server, and the page as one file."""
