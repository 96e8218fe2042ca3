"""Files of boards: written for fabrication and other programs, and read back."""
