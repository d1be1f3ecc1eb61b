"""Measurements of a running gas: its state, tracked disks, rows of windows, and sums.

=============  =============================================
`readout`      its present state
`tracking`     every collision of tracked disks
`window_log`   rows that the tiles of a window have recorded
`extra_tally`  sums that only some gases have
=============  =============================================
"""
