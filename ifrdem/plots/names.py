"""Names of pictures of a trajectory. `ifrdem --help` lists them, so this imports nothing."""

PICTURES = {
    "temperatures": "both temperatures and their ratio against time, with kinetic theory where it holds",
    "disks": "the disks of a frame, coloured by spin, or a map of density if there are many",
    "energy": "translational, rotational and potential energy against time",
    "ledger": "present, dissipated and put-in energy against time, and their residual",
    "mechanisms": "energy dissipated by each mechanism",
    "walls": "force, torque, work and heat of each wall or group against time (output.wall_sums)",
    "piston": "displacement and velocity of each piston against time",
    "dissipation": "a map of the energy that collisions take, and its mechanisms (field dissipated)",
    "velocity": "distributions of velocities and spins, with Gaussians",
    "rdf": "pair correlation g(r) and its contact value",
    "structure-factor": "structure factor S(k)",
    "msd": "mean-square displacement and the diffusion coefficient",
    "vacf": "velocity autocorrelation",
    "profiles": "density, flow, temperatures, stress and heat flux along an axis, with errors",
    "fields": "maps of density, flow and thermal temperature",
    "clusters": "the largest cluster in time, and cluster sizes",
    "psi6": "hexatic order of the disks",
    "stress": "pressure tensor against time, and its kinetic and collisional part (output.stress)",
    "velocity-correlation": "correlation of velocities along and across r, and the correlation length",
    "vorticity": "spectrum of the velocity field across and along k, and the wavelength of its maximum",
    "species": "temperatures of each species, their ratios and theta, with kinetic theory",
    "cooling": "Haff's law, and the approach of T_rot / T to its end",
    "impact": "impact angles compared with molecular chaos, and regimes",
}
"""Name -> what is drawn."""
OPTIONS = {"axis": "profiles", "bins": "profiles", "cells": "fields", "average": "fields"}
"""Option -> the analysis that takes it."""
