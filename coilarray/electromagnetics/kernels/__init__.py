"""Arithmetic on arrays in SI, nothing else: numba kernels, and NumPy where linear algebra does the work.

No validation, no units, no coils: the friendly functions of the package do that. Every numba kernel is serial and
releases the interpreter's lock; `coilarray.compute.threads` runs several at once.
"""
