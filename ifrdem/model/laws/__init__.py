"""Collision laws: the base of every law, the laws of the field, custom laws, and the laws of all pairs of a gas.

`law`: `CollisionLaw`. `ifr`, `walton`, `viscoelastic`: laws by name. `coin_table`: the paper's coins. `collision`: a
single collision. `files`, `records`, `sampling`: custom laws from files, laws in records, checks by random pairs.
"""
