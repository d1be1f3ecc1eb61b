"""Validation: the paper's equations and the cases that hold the simulation against them."""
