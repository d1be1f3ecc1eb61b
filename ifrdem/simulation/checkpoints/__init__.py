"""Complete states, in files and in memory, to resume from.

============  ================================================
`checkpoint`  files of checkpoints
`gas_record`  arguments of a simulation in JSON
`snapshot`    the complete state of an engine, to the last bit
============  ================================================
"""
