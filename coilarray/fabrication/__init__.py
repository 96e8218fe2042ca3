"""Files of boards: written for fabrication, and read back."""
