"""Solids as files: STL and STEP (mm), GLB (m)."""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from coilarray.compute.arrays import FloatArray
from coilarray.compute.extras import import_extra
from coilarray.compute.files import require_suffix, write_atomically, write_bytes
from coilarray.errors import OutputError
from coilarray.geometry.array import Array
from coilarray.geometry.copper import Prism, board_prisms, disc, drills, sheet_prisms, solids
from coilarray.geometry.elastomer import Sheet
from coilarray.geometry.pose import Pose

if TYPE_CHECKING:
    import trimesh

Part = TypeVar("Part")

_MM = 1e3
COLOURS = {  # red, green, blue and opacity, up to 255, of each kind of solid, by the first part of its key
    "copper": (200, 117, 51, 255),
    "barrel": (184, 134, 72, 255),
    "board": (24, 92, 52, 160),
    "sheet": (110, 110, 118, 90),
}
_OTHER = (160, 160, 160, 255)
_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # glTF's (x, z, −y)


def write_solids(parts: Mapping[str, trimesh.Trimesh], path: Path) -> None:
    """Write solids in m, as one mesh in mm to STL, or by names with y up to GLB."""
    import trimesh  # slow to import

    require_suffix(path, ".stl", ".glb")
    if not parts:
        raise OutputError(f"cannot write {path}: there are no solids.")
    if path.suffix.lower() == ".stl":
        merged: Any = trimesh.util.concatenate([mesh.copy() for mesh in parts.values()])
        merged.vertices *= _MM
        write_bytes(path, merged.export(file_type="stl"))
        return
    scene: Any = trimesh.Scene()  # trimesh is typed in part only
    for name, solid in parts.items():
        mesh = solid.copy()
        colour = np.array(COLOURS.get(name.split("/")[0], _OTHER), dtype=np.uint8)
        mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=np.tile(colour, (len(mesh.vertices), 1)))
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    scene.apply_transform(_Y_UP)
    write_bytes(path, scene.export(file_type="glb"))


_ON_CIRCLE = 1e-9  # of the radius, of a circle's corners; other corners lie on it only by accident
_SHORTEST = 1e-9  # m: edges below 0.1 nm do not exist for Open CASCADE
_CORNERS = len(shapely.get_coordinates(disc(0.0, 0.0, 1.0))) - 1


@dataclass(frozen=True)
class PlacedArray:
    """Board in an assembly: its pose, its sheets, and the start of the names of its coils."""

    array: Array
    sheets: Sequence[Sheet] = ()
    pose: Pose = field(default_factory=Pose)
    prefix: str = ""
    laminate: bool = True

    def named(self, parts: Mapping[str, Part]) -> dict[str, Part]:
        """Give parts with the keys of `solids` the names that they have in the assembly.

        >>> from coilarray import load_design
        >>> one = PlacedArray(load_design("proximity").array, prefix="receiver/")
        >>> list(one.named({"copper/L1/coil1": 1, "barrel/coil1/0": 2, "board": 3}))
        ['copper/L1/receiver/coil1', 'barrel/receiver/coil1/0', 'board/receiver']
        """
        named = {}
        for key, part in parts.items():
            kind, _, rest = key.partition("/")
            layer, _, coil = rest.partition("/")
            name = f"copper/{layer}/{self.prefix}{coil}" if kind == "copper" else f"{kind}/{self.prefix}{rest}"
            if kind != "board" or self.laminate:
                named[name.rstrip("/")] = part
        return named


def assembled(boards: Iterable[PlacedArray]) -> dict[str, trimesh.Trimesh]:
    """Return the solids of boards in space in m, by their names in the assembly."""
    found = {}
    for board in boards:
        for name, solid in board.named(solids(board.array, board.sheets)).items():
            solid.vertices = board.pose.apply(solid.vertices)
            found[name] = solid
    return found


def write_step(boards: Sequence[PlacedArray], path: Path, *, name: str) -> None:
    """Write boards and their sheets as STEP in mm, of named and coloured parts.

    Barrels, drilled holes and free edges of pads are true cylinders. Everything else has flat
    faces, also the arcs of traces, by `faceted_prisms`. z = 0 is the top of the top copper of a
    board at its own place. A bent board raises an OutputError.
    """
    require_suffix(path, ".step", ".stp")
    if any(board.array.form is not None for board in boards):
        raise OutputError(f"cannot write {path}: STEP is written of flat boards only; a bent one goes to .stl or .glb.")
    import_extra("OCP.STEPCAFControl", "STEP files", package="cadquery-ocp-novtk", extra="step")
    parts: dict[str, tuple[Any, Any]] = {}
    for board in boards:
        array = board.array
        circles = np.array(  # centres and radii in m of pads, holes and the inside of barrels
            sorted(
                {
                    (hole.x, hole.y, wide / 2)
                    for hole in drills(array)
                    for wide in (hole.pad, *((hole.diameter, hole.diameter - 2 * hole.plating) if hole.drilled else ()))
                }
            )
        ).reshape(-1, 3)
        prisms, place = sheet_prisms(array, board.sheets) | faceted_prisms(array), _location(board.pose)
        parts |= board.named({key: (_part(prism, circles), place) for key, prism in prisms.items()})
    document = _document(name, parts)
    write_atomically(path, lambda temporary: _write(document, temporary, name))


def _location(pose: Pose) -> Any:
    from OCP.gp import gp_Trsf
    from OCP.TopLoc import TopLoc_Location

    if pose == Pose():
        return TopLoc_Location()
    turn = gp_Trsf()
    turn.SetValues(*np.column_stack((pose.rotation, pose.shift * _MM)).ravel().tolist())
    return TopLoc_Location(turn)


def faceted_prisms(array: Array) -> dict[str, Prism]:
    """Return the prisms of a board with coarser arcs."""
    prisms = board_prisms(array)
    coils = {id(place.coil): place.coil for place in array.placements if any(place.coil.arcs)}
    if not coils:
        return prisms
    made = {}
    for key, coil in coils.items():
        lines, widths = zip(*coil.current_lines(), strict=True)
        made[key] = replace(coil, lines=lines, widths=widths, arcs=())
    placements = (replace(place, coil=made.get(id(place.coil), place.coil)) for place in array.placements)
    coarse = board_prisms(replace(array, placements=tuple(placements)))
    return {key: coarse[key] if key.startswith("copper/") else prism for key, prism in prisms.items()}


def _part(prism: Prism, circles: FloatArray) -> Any:
    """Make the solid of a prism with arcs of `circles` (n, 3): centres and radii in m."""
    from OCP.BRep import BRep_Builder
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Dir, gp_Pln, gp_Pnt, gp_Vec
    from OCP.TopoDS import TopoDS_Compound

    solids, z = [], prism.bottom * _MM
    for outline in map(orient, shapely.get_parts(shapely.remove_repeated_points(prism.shape, _SHORTEST))):
        plane = gp_Pln(gp_Pnt(0.0, 0.0, z), gp_Dir(0.0, 0.0, 1.0))
        face = BRepBuilderAPI_MakeFace(plane, _wire(outline.exterior, z, circles))
        for hole in outline.interiors:
            face.Add(_wire(hole, z, circles))
        solids.append(BRepPrimAPI_MakePrism(face.Face(), gp_Vec(0.0, 0.0, (prism.top - prism.bottom) * _MM)).Shape())
    if len(solids) == 1:
        return solids[0]
    compound, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(compound)
    for solid in solids:
        builder.Add(compound, solid)
    return compound


def _wire(ring: shapely.LinearRing, z: float, circles: FloatArray) -> Any:
    """Make the closed wire of a ring with arcs."""
    from OCP.BRep import BRep_Builder
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeVertex
    from OCP.gp import gp_Pnt
    from OCP.TopoDS import TopoDS_Wire

    corners = shapely.get_coordinates(ring)[:-1]
    owners = np.full(len(corners), -1)  # circle on which the edge from each corner lies, −1 for a straight edge
    if len(circles):
        centre_x, centre_y, radii = circles.T
        offset = np.hypot(corners[:, :1] - centre_x, corners[:, 1:] - centre_y) - radii
        on = np.abs(offset) <= _ON_CIRCLE * radii
        length = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)[:, None]
        chord = 2 * radii * math.sin(math.pi / _CORNERS)
        own = on & np.roll(on, -1, axis=0) & (np.abs(length - chord) <= 1e-6 * chord)
        owners = np.where(own.any(axis=1), own.argmax(axis=1), -1)
    wire, builder = TopoDS_Wire(), BRep_Builder()
    builder.MakeWire(wire)
    # corners at which a straight edge or a run of edges of one circle begins
    starts = np.flatnonzero((owners < 0) | (owners != np.roll(owners, 1)))
    if not len(starts):
        builder.Add(wire, BRepBuilderAPI_MakeEdge(_circle(circles[owners[0]], z, counter_clockwise=ring.is_ccw)).Edge())
        wire.Closed(True)
        return wire
    vertices = [BRepBuilderAPI_MakeVertex(gp_Pnt(x, y, z)).Vertex() for x, y in (corners[starts] * _MM).tolist()]
    for k, (start, end) in zip(starts.tolist(), pairwise([*vertices, vertices[0]]), strict=True):
        if owners[k] < 0:
            edge = BRepBuilderAPI_MakeEdge(start, end)
        else:
            x, y, _ = circle = circles[owners[k]]
            (ax, ay), (bx, by) = corners[k] - (x, y), corners[(k + 1) % len(corners)] - (x, y)
            edge = BRepBuilderAPI_MakeEdge(_circle(circle, z, counter_clockwise=ax * by > ay * bx), start, end)
        builder.Add(wire, edge.Edge())
    wire.Closed(True)
    return wire


def _circle(circle: FloatArray, z: float, *, counter_clockwise: bool) -> Any:
    from OCP.gp import gp_Ax2, gp_Circ, gp_Dir, gp_Pnt

    x, y, radius = (circle * _MM).tolist()
    return gp_Circ(gp_Ax2(gp_Pnt(x, y, z), gp_Dir(0.0, 0.0, 1.0 if counter_clockwise else -1.0)), radius)


def _document(name: str, parts: Mapping[str, tuple[Any, Any]]) -> Any:
    """Put named and coloured parts at their locations into one assembly."""
    from OCP.Quantity import Quantity_Color, Quantity_ColorRGBA, Quantity_TOC_sRGB
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_DocumentTool

    document = TDocStd_Document(TCollection_ExtendedString("MDTV-XCAF"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    assembly = shapes.NewShape()
    TDataStd_Name.Set_s(assembly, TCollection_ExtendedString(name, True))
    for key, (part, place) in parts.items():
        label = shapes.AddShape(part, False)
        component = shapes.AddComponent(assembly, label, place)
        for named in (label, component):
            TDataStd_Name.Set_s(named, TCollection_ExtendedString(key, True))
        *rgb, opacity = (part / 255 for part in COLOURS[key.split("/")[0]])
        colours.SetColor(label, Quantity_ColorRGBA(Quantity_Color(*rgb, Quantity_TOC_sRGB), opacity), XCAFDoc_ColorGen)
    shapes.UpdateAssemblies()
    return document


def _write(document: Any, path: Path, name: str) -> None:
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.Message import Message, Message_Gravity
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_Controller
    from OCP.TCollection import TCollection_HAsciiString

    STEPControl_Controller.Init_s()  # creates the settings
    # curves on the faces are redundant for planes and cylinders, and double the file
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)
    for printer in Message.DefaultMessenger_s().Printers():  # of the progress, to standard output
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    # Open CASCADE takes names in UTF-8 alone
    with tempfile.TemporaryDirectory() as folder:
        writer = STEPCAFControl_Writer()
        writer.Transfer(document)
        header = APIHeaderSection_MakeHeader(writer.ChangeWriter().Model())
        header.SetName(TCollection_HAsciiString(name))
        header.SetOriginatingSystem(TCollection_HAsciiString("coilarray"))
        header.SetAuthorValue(1, TCollection_HAsciiString(""))
        header.SetOrganizationValue(1, TCollection_HAsciiString(""))
        plain = Path(folder) / "board.step"
        if writer.Write(str(plain)) != IFSelect_RetDone:
            raise OSError("Open CASCADE could not write the file")
        shutil.copyfile(plain, path)
