"""Validation against the paper: its equations, figures and tables, through the kernels."""
