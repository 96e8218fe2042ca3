"""The commands ``coilarray board …``: a board read out, real or emulated."""
