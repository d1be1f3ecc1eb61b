"""Validation: the paper's equations and the cases that compare the simulation with them."""
