"""Response of the sensor to an indentation."""
