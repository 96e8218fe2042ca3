"""Numba kernels: C-contiguous float64 arrays in SI in, arithmetic, nothing else.

No validation, no units, no objects: the functions in `coilarray.field` and `coilarray.inductance` do that. Every
kernel is serial and releases the interpreter's lock; `coilarray.blocks` runs several at once.
"""
