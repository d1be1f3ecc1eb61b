"""Collision laws: the base of every law, the laws of the field, custom laws, and the laws of all pairs of a gas.

`law`: `CollisionLaw`. `ifr` and others: laws by name, which `records` lists. `coin_table`: the paper's coins.
`collision`: a single collision. `files`, `sampling`: custom laws from files, checks by random pairs.
"""
