"""Requests: the conditions and surroundings that they name, their errors and statuses."""

import dataclasses
import math
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.msg import Surroundings as SurroundingsMsg

from resting_aspects_ros.aspects.estimate import METHODS, NotDefinedError
from resting_aspects_ros.errors import (
    InvalidValueError,
    PartError,
    RestingAspectsError,
    UnknownPartError,
    did_you_mean,
    shown,
)
from resting_aspects_ros.input_files import is_folder
from resting_aspects_ros.part.library import unknown_part_text
from resting_aspects_ros.part.part import is_valid_name
from resting_aspects_ros.ros.callbacks import advertise, subscribe, wait_for
from resting_aspects_ros.ros.conversions import conditions_from, conditions_msg
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import DEFAULT_CONDITIONS, LATCHED, SERVICES
from resting_aspects_ros.ros.program import Parameter, on_change
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SURFACE,
    DropConditions,
    Surfaces,
)
from resting_aspects_ros.simulation.surroundings import (
    Surroundings,
    named_surroundings,
    surroundings_folder,
)
from resting_aspects_ros.simulation.surroundings_kinds import MeshFile, MeshSurface
from resting_aspects_ros.statistics.distribution import METHOD

# -- Errors and statuses --------------------------------------------------------------------------


class NotAvailableError(RestingAspectsError):
    """A valid request cannot be answered now, or not by this version."""


class BusyError(RestingAspectsError):
    """Too many requests are active."""


class CanceledError(RestingAspectsError):
    """A request was canceled before it was done."""


_CODES: dict[type[RestingAspectsError], int] = {
    UnknownPartError: Status.UNKNOWN_PART,
    InvalidValueError: Status.INVALID,
    PartError: Status.INVALID,
    NotAvailableError: Status.NOT_AVAILABLE,
    NotDefinedError: Status.INVALID,
    BusyError: Status.BUSY,
    CanceledError: Status.CANCELED,
}


def error_status(error: RestingAspectsError) -> Status:
    """Return the status that reports an error to a client."""
    return Status(code=_CODES.get(type(error), Status.FAILED), message=str(error))


def serve(node: Node, kind: Any, name: str, answer: Callable[[Any, Any], Awaitable[None]]) -> None:
    """Create a service; an error of ``answer`` becomes the status of the response.

    Parameters
    ----------
    answer : coroutine function
        Fills in the response to a request. Its numbers are NaN and its status is OK before.
    """

    async def respond(request: Any, response: Any) -> Any:
        for field, field_type in response.get_fields_and_field_types().items():
            if field_type == 'double':
                setattr(response, field, math.nan)
        response.status = Status(code=Status.OK)
        try:
            await answer(request, response)
        except RestingAspectsError as error:
            response.status = error_status(error)
        except Exception as error:  # noqa: BLE001 - the edge: a defect must not stop the node
            node.get_logger().error(f'{name} failed: {error!r}')
            response.status = Status(code=Status.FAILED, message=f'unexpected error {error!r}')
        return response

    # In the default group of the node, a waiting request would block what it waits for.
    group = ReentrantCallbackGroup()
    node.create_service(kind, name, respond, qos_profile=SERVICES, callback_group=group)


def status_error(answer: Status) -> RestingAspectsError:
    """Return the error that a status reports."""
    kinds = {code: kind for kind, code in reversed(_CODES.items())}
    return kinds.get(answer.code, RestingAspectsError)(answer.message)


def requested_estimator(method: str) -> str | None:
    """Return the requested estimator, or None for drops; raises InvalidValueError."""
    if method in ('', METHOD):
        return None
    if method not in METHODS:
        raise InvalidValueError(
            f'invalid method {shown(method)}: expected {METHOD} or one of {", ".join(METHODS)}'
        )
    return method


def unknown_part(name: str, known: Iterable[str]) -> UnknownPartError:
    """Return the error for a name that is not one of the known parts."""
    none = 'none, because no simulator has offered any yet'
    return UnknownPartError(unknown_part_text(name, known, none))


# -- Conditions and surroundings ------------------------------------------------------------------


SURFACE = Parameter(
    'surface',
    DEFAULT_SURFACE,
    'surface of requests that do not name one',
    allowed='a name in surfaces_file',
    changeable=True,
)
# Timeout for the latched message of a discovered simulator, s.
RECEIVE_TIMEOUT = 10.0


class DefaultConditionsPublisher:
    """Publishes the conditions of the parameter `surface` as default_conditions."""

    def __init__(self, node: Node, surfaces: Surfaces) -> None:
        self._surfaces = surfaces
        self._publisher = advertise(node, DropConditionsMsg, DEFAULT_CONDITIONS, LATCHED)
        on_change(node, SURFACE.name, surfaces.get, self._publish)
        self._publish(node.get_parameter(SURFACE.name).value)

    @property
    def conditions(self) -> DropConditions:
        """The conditions of a request that does not name a surface."""
        return self._conditions

    def _publish(self, name: str) -> None:
        self._conditions = self._surfaces.get(name)
        self._publisher.publish(conditions_msg(self._conditions))


class DefaultConditionsSubscriber:
    """Receives default_conditions of the simulator in the namespace of a node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._conditions: DropConditions | None = None
        self._received = Future()  # done with the first message
        subscribe(node, DropConditionsMsg, DEFAULT_CONDITIONS, self._receive, LATCHED)

    @property
    def is_received(self) -> bool:
        """Whether a simulator has published its default conditions."""
        return self._conditions is not None

    async def conditions(self) -> DropConditions:
        """Return the conditions of a request that does not name a surface.

        Waits for the message of a discovered simulator. Raises NotAvailableError if no simulator
        has published the conditions yet.
        """
        if self._node.count_publishers(DEFAULT_CONDITIONS):
            await wait_for(self._node, self._received, RECEIVE_TIMEOUT)
        if self._conditions is None:
            raise NotAvailableError(
                'no drop_simulator has published its default surface yet: name a surface, or '
                'start drop_simulator'
            )
        return self._conditions

    def _receive(self, message: DropConditionsMsg) -> None:
        self._conditions = conditions_from(message)
        if not self._received.done():
            self._received.set_result(None)


SURROUNDINGS_FOLDER = Parameter(
    'surroundings_folder',
    '',
    'folder of YAML files of named surroundings; empty: those of the suite',
)


def names_in(folder: Path) -> list[str]:
    """Return the names of the surroundings in a folder, sorted."""
    return sorted(file.stem for file in folder.glob('*.yaml') if is_valid_name(file.stem))


def read_named(folder: Path, name: str) -> Surroundings:
    """Return the surroundings with a name in a folder; runs in a FileWorker."""
    names = names_in(folder)
    if name not in names:
        raise InvalidValueError(
            f'invalid surroundings {shown(name)}: expected one of {", ".join(names)}'
            f'{did_you_mean(name, names)}'
        )
    return named_surroundings(folder / f'{name}.yaml')


def find_mesh(folder: Path, sha256: str) -> MeshFile | None:
    """Return the mesh with a hash of any surroundings in a folder; runs in a FileWorker."""
    for name in names_in(folder):
        with suppress(RestingAspectsError):  # what cannot be read is not what is searched
            mesh = read_named(folder, name).shape.file
            if mesh is not None and mesh.sha256 == sha256:
                return mesh
    return None


class RequestedSurroundings:
    """Finds the surroundings that goals and requests name.

    Files are read in a FileWorker, and again for each request, so that a changed file is used.
    Clients send no paths: the mesh of given surroundings must be one of the folder.
    """

    def __init__(self, node: Node, folder: str, files: FileWorker) -> None:
        self._folder = Path(folder or surroundings_folder())
        if not is_folder(self._folder):
            raise InvalidValueError(
                f'invalid {SURROUNDINGS_FOLDER.name} {folder!r}: expected an existing folder'
            )
        self._node = node
        self._files = files

    async def conditions(
        self, surfaces: Surfaces, request: Any, default: DropConditions
    ) -> DropConditions:
        """Return the conditions of a goal or request; raises InvalidValueError.

        They are the given conditions, else those of the named surface in the given surroundings;
        without a surface the default.
        """
        if not request.conditions:
            found = surfaces.get(request.surface) if request.surface else default
            return dataclasses.replace(found, surroundings=await self.named(request.surroundings))
        message = request.conditions[0]
        name = message.surroundings.name
        if message.surroundings == SurroundingsMsg(name=name):  # the name alone
            message.surroundings = SurroundingsMsg()
        given = surfaces.named(conditions_from(message))
        around = given.surroundings
        if around is None:
            around = await self.named(name)
        elif not around.known:
            around = await self._with_mesh(around)
        return dataclasses.replace(given, surroundings=around)

    async def named(self, name: str) -> Surroundings | None:
        """Return the surroundings with a name; None for an empty one."""
        return await self._files.run(read_named, self._folder, name) if name else None

    async def _with_mesh(self, around: Surroundings) -> Surroundings:
        """Return the surroundings of a mesh whose file is known by its hash, with the mesh."""
        shape = around.shape
        assert isinstance(shape, MeshSurface)  # other kinds are always known
        mesh = await self._files.run(find_mesh, self._folder, shape.mesh_sha256)
        if mesh is None:
            raise InvalidValueError(
                f'invalid mesh {shown(shape.mesh)} of surroundings: expected one of the '
                f'surroundings in {SURROUNDINGS_FOLDER.name} of {self._node.get_name()}'
            )
        return around.with_mesh(mesh)
