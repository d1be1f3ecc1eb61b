"""The viewer of trajectories: a page for browsers, the server behind it, and the page as one file."""
