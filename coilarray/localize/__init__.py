"""Position and depth of an indentation from the responses of the coils."""
