"""The design file and the design that is made of it."""
