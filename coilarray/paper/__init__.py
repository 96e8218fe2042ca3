"""Models and tables of Gast & Zimmermann (2020) and their FEM paper."""
