"""Coils, switches and converter tank as one network, and the files that carry it to other programs."""
