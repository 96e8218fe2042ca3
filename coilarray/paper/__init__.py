"""Models and tables of Gast & Zimmermann (2020) and of their paper on a FEM model."""
