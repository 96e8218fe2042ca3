"""The design file and its design."""
