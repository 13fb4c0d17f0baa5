"""The surroundings that goals and requests name: files of a folder of the node, or documents."""

import dataclasses
from collections.abc import Collection
from pathlib import Path
from typing import Any

from rclpy.node import Node

from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError, shown
from resting_aspects_ros.core.input_file import is_folder
from resting_aspects_ros.core.part import is_valid_name
from resting_aspects_ros.ros.conversions import conditions_from
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.parameters import Parameter
from resting_aspects_ros.ros.status import requested_conditions
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.config_files import surroundings_folder
from resting_aspects_ros.simulation.surfaces import Surfaces
from resting_aspects_ros.simulation.surroundings.library import (
    named_surroundings,
    surroundings_from,
)
from resting_aspects_ros.simulation.surroundings.mesh_surface import (
    MeshFile,
    MeshSurface,
    UnknownMeshError,
    known_mesh,
    remember_mesh,
)

SURROUNDINGS_FOLDER = Parameter(
    'surroundings_folder',
    '',
    'folder of YAML files of named surroundings; empty: those of the suite',
)
# The key of surroundings, and their mesh if the node does not know it yet.
Found = tuple[str, MeshFile | None]


def names_in(folder: Path) -> list[str]:
    """Return the names of the surroundings in a folder, sorted."""
    try:
        return sorted(file.stem for file in folder.glob('*.yaml') if is_valid_name(file.stem))
    except OSError:
        return []


def read_named(folder: Path, name: str, known: Collection[str]) -> Found:
    """Return the surroundings with a name in a folder; runs in a FileWorker.

    known : hashes of the meshes that the node knows
    """
    names = names_in(folder)
    if name not in names:
        raise InvalidValueError(
            f'invalid surroundings {shown(name)}: expected a JSON document, or one of '
            f'{", ".join(names)}'
        )
    found = named_surroundings(folder / f'{name}.yaml')
    shape = found.shape
    if not isinstance(shape, MeshSurface) or shape.mesh_sha256 in known:
        return found.key, None
    return found.key, known_mesh(shape.mesh_sha256)


def read_all(folder: Path, known: Collection[str]) -> dict[str, Found | str]:
    """Return all surroundings in a folder, or why one is unusable; runs in a FileWorker."""
    all_found: dict[str, Found | str] = {}
    for name in names_in(folder):
        try:
            all_found[name] = read_named(folder, name, known)
        except RestingAspectsError as error:
            all_found[name] = str(error)
    return all_found


class RequestedSurroundings:
    """Finds the surroundings that goals and requests name.

    Files are read in a FileWorker, and again for each request, so that a changed file is used. A
    document with a mesh is accepted only if the mesh belongs to surroundings of the folder:
    clients send no paths.
    """

    def __init__(self, node: Node, folder: str, files: FileWorker) -> None:
        self._folder = Path(folder or surroundings_folder())
        if not is_folder(self._folder):
            raise InvalidValueError(
                f'invalid {SURROUNDINGS_FOLDER.name} {folder!r}: expected an existing folder'
            )
        self._node = node
        self._files = files
        self._meshes: set[str] = set()  # their hashes
        self._names: dict[str, str] = {}  # by key

    async def conditions(
        self, surfaces: Surfaces, request: Any, default: DropConditions
    ) -> DropConditions:
        """Return the conditions of a goal or request; raises InvalidValueError.

        They are the given conditions, else those of the named surface in the given surroundings;
        without a surface the default.
        """
        if request.conditions:
            message = request.conditions[0]
            message.surroundings = await self.key(message.surroundings)
            return surfaces.named(conditions_from(message))
        found = requested_conditions(surfaces, request.surface, [], default)
        return dataclasses.replace(found, surroundings=await self.key(request.surroundings))

    async def key(self, requested: str) -> str:
        """Return the key of surroundings that are given by name or by a JSON document."""
        if not requested:
            return ''
        if not requested.lstrip().startswith('{'):
            found = await self._files.run(read_named, self._folder, requested, self._meshes)
            return self._add(requested, found)
        try:
            key = surroundings_from(requested).key
            if key in self._names:
                return key
        except UnknownMeshError:
            pass
        # For the mesh of the document, or the name of surroundings that another node resolved.
        await self._read_all()
        try:
            return surroundings_from(requested).key
        except UnknownMeshError as error:
            raise InvalidValueError(
                f'{error}: one of the surroundings in {SURROUNDINGS_FOLDER.name} of '
                f'{self._node.get_name()} must have it'
            ) from None

    def name(self, key: str) -> str:
        """Return the name of surroundings that were requested by name; otherwise their kind."""
        return self._names.get(key) or surroundings_from(key).shape.kind

    def meshes(self) -> list[MeshFile]:
        """Return the known meshes, which a FileWorker needs in order to plan drops."""
        return [mesh for sha256 in self._meshes if (mesh := known_mesh(sha256)) is not None]

    async def _read_all(self) -> None:
        found = await self._files.run(read_all, self._folder, self._meshes)
        for name, each in found.items():
            if isinstance(each, str):
                self._node.get_logger().warning(each)
            else:
                self._add(name, each)

    def _add(self, name: str, found: Found) -> str:
        key, mesh = found
        if mesh is not None:
            remember_mesh(mesh)
            self._meshes.add(mesh.sha256)
        self._names[key] = name
        return key
