"""A gas in a file, and in memory, to go on from.

============  ================================================
`checkpoint`  files of checkpoints
`gas_record`  arguments of a simulation as JSON has them
`snapshot`    the complete state of an engine, to the last bit
============  ================================================
"""
