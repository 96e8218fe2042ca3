"""Position and depth of an indentation from the coils' responses."""
