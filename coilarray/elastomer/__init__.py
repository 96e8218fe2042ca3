"""The elastomer on the board: how it deforms under an indenter, and what its magnetic sheet does to the coils."""
