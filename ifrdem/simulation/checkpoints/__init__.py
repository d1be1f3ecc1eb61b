"""Complete states, in files and in memory, to resume from.

============  ================================================
`checkpoint`  files of checkpoints
`snapshot`    the complete state of an engine, to the last bit
============  ================================================
"""
