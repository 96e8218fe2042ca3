"""Elastomer on the board: deformation, and effect of its magnetic sheet."""
