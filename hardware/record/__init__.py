"""Recordings of a board and their evaluation."""
