"""An emulator of NVIDIA GPUs on a CPU; README.md says how it works."""
