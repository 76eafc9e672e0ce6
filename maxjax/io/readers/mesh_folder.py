"""Folders and ZIP archives of meshes, and scenes of Mitsuba: all meshes in them as one map.

A folder with one scene (.xml) is that scene; any other is all of its meshes, subfolders included. Each file keeps its
own bodies. What is no mesh (textures, materials, notes) is counted.
"""

from __future__ import annotations

import dataclasses
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

from maxjax.core.files import MAX_FILE_BYTES, FileError
from maxjax.io.archives import DAMAGED_ZIP
from maxjax.io.kinds.mesh import MAX_FACES, Mesh, merge_meshes
from maxjax.io.readers.gltf_mesh import load_gltf
from maxjax.io.readers.mitsuba import is_scene, load_mitsuba
from maxjax.io.readers.obj import load_obj
from maxjax.io.readers.ply import load_ply
from maxjax.io.readers.stl import load_stl
from maxjax.io.reading import PLAIN, Reading

MESHES: Mapping[str, Callable[[Path, Reading], object]] = {
    ".ply": load_ply,
    ".obj": load_obj,
    ".stl": load_stl,
    ".glb": load_gltf,
}
_MOST_FILES = 20_000


def load_folder(path: Path, reading: Reading = PLAIN) -> Mesh:
    """The meshes of a folder as one.

    Raises:
        FileError: if it holds no mesh, too many files or bytes, several scenes, or a mesh that cannot be read.
    """
    files = []
    for file in sorted(path.rglob("*")):
        if file.is_file():
            files.append(file)
        if len(files) > _MOST_FILES:
            raise FileError(f"{path}: expected at most {_MOST_FILES} files, found more")
    scenes = [file for file in files if file.suffix.lower() == ".xml" and is_scene(file)]
    if len(scenes) > 1:
        names = ", ".join(file.name for file in scenes[:4])
        raise FileError(f"{path}: expected one scene, found {len(scenes)} ({names}); name the one to read")
    if scenes:
        return dataclasses.replace(load_mitsuba(scenes[0], reading), source=path.name)
    chosen = [file for file in files if file.suffix.lower() in MESHES]
    if not chosen:
        raise FileError(f"{path}: expected meshes ({', '.join(MESHES)}) in the folder, found none")
    _check_size(sum(file.stat().st_size for file in chosen), path)
    dropped = _others([file.name for file in files if file.suffix.lower() not in MESHES])
    found: list[Mesh] = []
    faces = 0
    for file in chosen:
        mesh = MESHES[file.suffix.lower()](file, reading)
        if isinstance(mesh, Mesh):
            found.append(mesh)
            faces += len(mesh.triangles)
        else:
            dropped["files of points"] += 1
        if faces > MAX_FACES:
            raise FileError(f"{path}: expected at most {MAX_FACES} triangles in all, found more; crop or thin it")
    if not found:
        raise FileError(f"{path}: expected meshes in the folder, found points alone")
    return merge_meshes(found, path.name, dropped)


def load_zip(path: Path, reading: Reading = PLAIN) -> Mesh:
    """The meshes of a ZIP archive as one; raises as `load_folder`, and a FileError for an archive that is damaged."""
    try:
        with zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory(prefix="maxjax-") as scratch:
            members = [member for member in archive.infolist() if not member.is_dir()]
            if len(members) > _MOST_FILES:
                raise FileError(f"{path}: expected at most {_MOST_FILES} files, found {len(members)}")
            kept = [m for m in members if Path(m.filename).suffix.lower() in (*MESHES, ".xml")]
            _check_size(sum(member.file_size for member in kept), path)
            for member in kept:
                archive.extract(member, scratch)  # within the folder, whatever its name is
            try:
                found = load_folder(Path(scratch), reading)
            except FileError as error:
                raise FileError(f"{path}: {str(error).replace(scratch, path.name)}") from error
    except FileError:
        raise
    except (*DAMAGED_ZIP, ValueError) as error:
        raise FileError(f"{path}: expected an intact ZIP archive: {error}") from error
    left = _others([m.filename for m in members if Path(m.filename).suffix.lower() not in (*MESHES, ".xml")])
    return dataclasses.replace(found, source=path.name, dropped={**found.dropped, **left})


def _others(names: list[str]) -> Counter[str]:
    """Files that hold no mesh, by their kind."""
    return Counter(f"{Path(name).suffix.lower() or 'other'} files" for name in names)


def _check_size(size: int, path: Path) -> None:
    if size > MAX_FILE_BYTES:
        raise FileError(f"{path}: holds {size} bytes of meshes, expected at most {MAX_FILE_BYTES}; crop or thin it")
