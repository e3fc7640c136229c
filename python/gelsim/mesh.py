"""Meshes that are pressed by `Simulator`."""

from __future__ import annotations

import hashlib
import os
import warnings
from os import PathLike
from typing import TYPE_CHECKING, Any, Optional, Protocol, Union

from gelsim import _native
from gelsim._native import ReadyMesh, UsageError
from gelsim.checks import Checks, honest, kind, path_text
from gelsim.needed import need

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


class HasMesh(Protocol):
    """What has corners and triangles, as a `trimesh.Trimesh`."""

    @property
    def vertices(self) -> Any: ...
    @property
    def faces(self) -> Any: ...


class Mesh:
    """A triangle mesh in millimetres, made ready once and pressed as often as you like, by any number of simulators.

    ```python
    ball = gelsim.Mesh.load("ball.stl")                      # any mesh format that the command reads
    cube = gelsim.Mesh(vertices_mm, faces)                   # arrays (N, 3) of corners and (M, 3) of triangles
    gear = gelsim.Mesh.of(trimesh.load("gear.obj"))          # anything with vertices and faces
    ```

    It is cleaned: triangles without area, doubles and corners that are not finite go, with a warning. It can be pickled: of a mesh that
    was loaded another process reads the file again, and refuses it if it has changed.
    """

    def __init__(self, vertices_mm: ArrayLike, faces: ArrayLike, *, name: str = "mesh") -> None:
        """Takes corners (N, 3) in mm, and triangles (M, 3) that count in them from 0. `name` is what labels call it."""
        numpy = need("numpy")
        corners = array("vertices_mm", vertices_mm, numpy)
        numbers = array("faces", faces, numpy)
        if corners.dtype.kind not in "iuf":
            raise TypeError(f"vertices_mm holds {corners.dtype}; give numbers, in mm")
        if numbers.size == 0:
            numbers = numbers.astype(numpy.uint32)
        if numbers.dtype.kind not in "iu":
            raise TypeError(f"faces holds {numbers.dtype}; give whole numbers that count in vertices_mm from 0")
        if numbers.size and not (0 <= numbers.min() and numbers.max() < len(corners)):
            raise UsageError(
                f"faces names corners {numbers.min()} to {numbers.max()}, and vertices_mm has {len(corners)}, counted from 0"
            )
        # Copies: who writes to the arrays later does not change the mesh.
        arrays = (numpy.array(corners, numpy.float64), numpy.array(numbers, numpy.uint32))
        self._ready, said = _native.mesh_of_arrays(*arrays)
        self._name = checked_name(name)
        self._rebuild: tuple[Any, ...] = (mesh_of_arrays, *arrays, name)
        self._warn(said)

    @classmethod
    def load(cls, path: Union[str, PathLike[str]], *, mm_per_unit: Optional[float] = None) -> Mesh:
        """Reads a mesh file: OBJ, STL, PLY, OFF, glTF, DAE, 3MF, URDF.

        `mm_per_unit` is what a coordinate of 1 is: 1000 for a file in metres. Without it a coordinate is what the file or its
        format says, else a millimetre. UsageError for what is no mesh, with a way out.
        """
        text = path_text(path, "a mesh file")
        checks = Checks()
        unit = checks.optional("mm_per_unit", mm_per_unit, 1e-9, 1e9)
        checks.done()
        try:
            text.encode()
        except UnicodeEncodeError:
            raise UsageError("path is not UTF-8: rename the file or its folder") from None
        mesh, said = mesh_of_file(text, unit)
        mesh._warn(said)
        return mesh

    @classmethod
    def of(cls, given: Union[HasMesh, Mesh]) -> Mesh:
        """Takes the `vertices` (mm) and `faces` of another library's mesh, such as trimesh's."""
        honest("mesh", given)
        if isinstance(given, Mesh):
            return given
        try:
            vertices, faces = given.vertices, given.faces
        except AttributeError as error:
            raise TypeError(f"mesh is {kind(given)}; give what has vertices and faces") from error
        return cls(vertices, faces)

    @property
    def name(self) -> str:
        """What labels call it: a file's name without its ending, or what was given."""
        return self._name

    @property
    def triangles(self) -> int:
        """Triangles that are left after cleaning."""
        return self._ready.triangles

    @property
    def bounds_mm(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """The least and the largest x, y and z of its corners."""
        (x, y, z), (right, bottom, top) = self._ready.bounds_mm
        return (x, y, z), (right, bottom, top)

    def __repr__(self) -> str:
        size = " x ".join(f"{high - low:.4g}" for low, high in zip(*self.bounds_mm))
        return f'<gelsim.Mesh "{self.name}": {self.triangles} triangles, {size} mm>'

    def __copy__(self) -> Mesh:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Mesh:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return self._rebuild[0], self._rebuild[1:]

    def _warn(self, said: list[str]) -> None:
        for each in said:
            warnings.warn(f"mesh {self.name!r}: {each}", stacklevel=3)


def mesh_of_file(path: str, mm_per_unit: Optional[float]) -> tuple[Mesh, list[str]]:
    """A file's mesh, and what to warn of."""
    mesh = Mesh.__new__(Mesh)
    mesh._ready, said = _native.mesh_of_file(path, mm_per_unit)
    mesh._name = os.path.splitext(os.path.basename(path))[0]
    mesh._rebuild = (reread, os.path.abspath(path), mm_per_unit, sha256(path))
    return mesh, said


def reread(path: str, mm_per_unit: Optional[float], expected: Optional[str] = None) -> Mesh:
    """A file's mesh in another process; what there is to warn of was said."""
    mesh, _ = mesh_of_file(path, mm_per_unit)
    if expected is not None and mesh._rebuild[-1] != expected:
        raise UsageError(f"{path} has changed since it was read; restore it, or read it again with gelsim.Mesh.load")
    return mesh


def sha256(path: str) -> Optional[str]:
    """Of a file's bytes; None of what is no file, such as a pipe, which can be read once."""
    if not os.path.isfile(path):
        return None
    found = hashlib.sha256()
    with open(path, "rb") as file:
        while part := file.read(1 << 20):
            found.update(part)
    return found.hexdigest()


def mesh_of_arrays(vertices_mm: Any, faces: Any, name: str) -> Mesh:
    """The same of arrays that were checked."""
    mesh = Mesh.__new__(Mesh)
    mesh._ready, _ = _native.mesh_of_arrays(vertices_mm, faces)
    mesh._name = name
    mesh._rebuild = (mesh_of_arrays, vertices_mm, faces, name)
    return mesh


def checked_name(name: str) -> str:
    """A name that a label can have."""
    honest("name", name)
    if not isinstance(name, str):
        raise TypeError(f"name is {kind(name)}; give a text")
    if len(name) > 200 or not name.isprintable():
        raise UsageError("name is none: give up to 200 characters that can be printed")
    return name


def array(name: str, given: ArrayLike, numpy: Any) -> Any:
    """An array (N, 3); TypeError for what is none."""
    honest(name, given)
    # Of another class numpy would take items for ever.
    if not isinstance(given, (list, tuple)) and not hasattr(given, "__array__"):
        raise TypeError(f"{name} is {kind(given)}; give an array (N, 3)")
    if isinstance(given, numpy.ma.MaskedArray):
        raise TypeError(f"{name} is a masked array; leave out what is masked")
    try:
        found = numpy.asarray(given)
    except (TypeError, ValueError, OverflowError) as error:
        raise TypeError(f"{name} is no array (N, 3): it is {kind(given)}") from error
    if found.dtype == object:
        raise TypeError(f"{name} holds objects; give an array (N, 3) of numbers")
    if found.ndim != 2 or found.shape[1] != 3:
        raise UsageError(f"{name} has the shape {found.shape}; give an array (N, 3)")
    return found
