"""The runtime, Taichi or quadrants, and what this program adds to its language.

================  ======================================================
`runtime`         which of the two compiles the kernels; imports neither
`start_patches`   patches that shorten each start
`language`        `ti` as the kernels import it; types of arrays
`compiler_fixes`  two corrections of what is compiled
`records`         columns of arrays by name
`signature`       kernels that take arrays of a gas, each named once
`frontends`       keys of compiled programs, of quadrants
`launch`          launches of a kernel with the same arrays
================  ======================================================
"""
