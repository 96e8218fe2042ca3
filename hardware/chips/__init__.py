"""Registers, codes and timing of the chips, without I/O."""
