"""H5MD trajectories: the layout, writing, reading, histories of tracked disks, views, export, repair."""
