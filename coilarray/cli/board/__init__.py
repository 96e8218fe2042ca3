"""Commands ``coilarray board …`` for a real or emulated board."""
