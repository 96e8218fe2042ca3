"""Datasets for pictures.

They are the model's solids, paths and fields as PyVista meshes, with no window and no colours.

Every coordinate of a dataset is in mm, because people read pictures of boards in mm. The values of its arrays stay in
SI. Their names contain the unit, as in ``"B (T)"``. PyVista is imported when the first dataset is made.
"""
