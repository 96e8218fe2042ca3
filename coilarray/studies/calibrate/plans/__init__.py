"""The calibration plans that come with the package."""
