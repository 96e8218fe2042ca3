"""The response of the sensor: what an indentation does to every coil."""
