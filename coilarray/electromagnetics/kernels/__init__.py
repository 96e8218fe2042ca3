"""Arithmetic on arrays in SI units: numba kernels, and NumPy if linear algebra does the work.

There is no validation, no units and no coils, which belong to the public functions of the package. Every numba kernel
is serial and releases the interpreter's lock. `coilarray.compute.threads` runs several at once.
"""
