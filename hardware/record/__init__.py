"""Recordings of a board, and what is made of them."""
