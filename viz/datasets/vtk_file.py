"""Datasets as files of VTK, which ParaView opens."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyvista

VTK_SUFFIXES = {"PolyData": ".vtp", "RectilinearGrid": ".vtr", "UnstructuredGrid": ".vtu"}
"""Suffix of the file of a dataset, by the name of its class."""


def vtk_text(mesh: pyvista.DataSet) -> str:
    """Return a PolyData, RectilinearGrid or UnstructuredGrid as the text of an XML file of VTK.

    Examples
    --------
    >>> import pyvista
    >>> vtk_text(pyvista.Box()).splitlines()[1].split()[:2]
    ['<VTKFile', 'type="PolyData"']
    """
    from vtkmodules import vtkIOXML

    # in memory: VTK says nothing, or crashes, where it cannot write a file
    writer: Any = getattr(vtkIOXML, f"vtkXML{type(mesh).__name__}Writer")()
    writer.SetInputData(mesh)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString())
