"""Actions at given times: output, forces in steps, rotation of gravity.

=============  ===================================================
`schedule`     times of output of a run
`slow_run`     warning of a run that takes far too long
`force_steps`  when each force acts, and its changes of the energy
`rotation`     rotating gravity
=============  ===================================================
"""
