"""Where an indentation is: from the responses of the coils to its position and depth."""
