"""The event engine and what drives it: `Simulation`, `DSMC`, schedules, checkpoints, the device."""
