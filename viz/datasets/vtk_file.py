"""Datasets as VTK files for ParaView."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyvista

VTK_SUFFIXES = {"PolyData": ".vtp", "RectilinearGrid": ".vtr", "UnstructuredGrid": ".vtu"}
"""Suffix of the file of a dataset, by the name of its class."""


def vtk_text(mesh: pyvista.DataSet) -> str:
    """Text of a dataset as an XML file of VTK.

    The dataset is a PolyData, RectilinearGrid or UnstructuredGrid.

    Examples
    --------
    >>> import pyvista
    >>> vtk_text(pyvista.Box()).splitlines()[1].split()[:2]
    ['<VTKFile', 'type="PolyData"']
    """
    from vtkmodules import vtkIOXML

    # The text is written in memory, because VTK is silent, or crashes, if it cannot write a file.
    writer: Any = getattr(vtkIOXML, f"vtkXML{type(mesh).__name__}Writer")()
    writer.SetInputData(mesh)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString())
