"""Elastomer on the board: deformation under an indenter, and effect of its magnetic sheet on the coils."""
