"""An emulated board: chips at the level of their registers, coils by this package's physics."""
