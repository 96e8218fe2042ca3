"""Solids, paths and fields of the model as PyVista meshes.

Every coordinate of a dataset is in mm, because people read pictures of boards in mm. The values of
its arrays are in SI, with the unit in their names, as in ``"B (T)"``. PyVista is imported when the
first dataset is made.
"""
