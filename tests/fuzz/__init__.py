"""Damaged and foreign files of every kind that the package reads: mutations, readers and what they may answer."""
