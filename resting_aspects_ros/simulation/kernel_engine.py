"""The entry to the kernel: what it needs of a job, and its compiled code."""

import ctypes
import hashlib
import os
import platform
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.simulation import kernel_data
from resting_aspects_ros.simulation.actions import RAMP_PERIODS
from resting_aspects_ros.simulation.conditions import CUDA
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.kernel_data import Body, Ground, Numerics, States, work_of
from resting_aspects_ros.simulation.release import TIME_LIMIT, Ends, initial_states, resting_poses
from resting_aspects_ros.simulation.scene import HalfSpace
from resting_aspects_ros.statistics.poses import RestingPoses


def drop_range(job: DropJob, first: int, end: int) -> RestingPoses:
    """Simulate the drops ``first`` to ``end - 1`` until they end.

    The pose of a drop depends only on the job and its index. Several threads can simulate ranges
    at the same time: the compiled code holds no lock of Python.
    """
    states = initial_states(job, first, end)
    ends, codes = np.empty((end - first, 15)), np.empty((end - first, 2), dtype=np.int64)
    motion = job.motion
    limit = TIME_LIMIT + states.flight
    if motion is not None:
        limit += motion.duration / job.time_unit
    numerics = Numerics().refined(job.refinement, not job.until_still)
    run: Callable[..., None] = simulate
    if job.engine == CUDA:  # which needs numba-cuda and a driver
        from resting_aspects_ros.simulation import kernel_cuda

        run = kernel_cuda.simulate
    run(
        body_of(job),
        ground_of(job),
        numerics,
        limit,
        (states.position, states.velocity, states.spin, states.orientation),
        ends,
        codes,
    )
    found = Ends(
        position=ends[:, :3],
        orientation=ends[:, 3:7],
        status=codes[:, 0].astype(np.uint8),
        minimum=codes[:, 1],
        time=ends[:, 7] + states.elapsed,
        growth=ends[:, 8],
    )
    return resting_poses(job, first, found)


@lru_cache(maxsize=16)
def body_of(job: DropJob) -> Body:
    """Return the part of a job for the kernel."""
    rule, axes = job.rest, Rotation.from_quat(job.axes)
    hull, landscape = rule.landscape.hull, rule.landscape

    def in_body(vectors: Array) -> Array:
        return np.ascontiguousarray(axes.apply(vectors, inverse=True))

    fans = hull.edges_of_points
    pairs = _edges(hull.points)
    return Body(
        points=np.ascontiguousarray(in_body(hull.points).T),
        starts=np.searchsorted(pairs[:, 0], np.arange(len(hull.points) + 1)),
        near=np.ascontiguousarray(pairs[:, 1]),
        fans=np.cumsum([0, *map(len, fans)]),
        edges=np.concatenate([np.array(each) for each in fans]),
        ends=np.ascontiguousarray(hull.ends),
        sides=np.ascontiguousarray(hull.sides),
        feet=np.ascontiguousarray(hull.feet),
        normals=in_body(hull.normals),
        minima=np.ascontiguousarray(landscape.minima_of_facets),
        directions=in_body(landscape.directions),
        exits=np.ascontiguousarray(rule.exits),
        margins=np.ascontiguousarray(rule.margins),
        heights=landscape.heights / landscape.radius,
        rollers=in_body(rule.rollers),
        moments=np.ascontiguousarray(job.moments),
    )


def _edges(points: Array) -> Array:
    """Return (k, 2) the edges of a convex hull in both directions, ordered by their first end."""
    hull = ConvexHull(points)
    beside = hull.equations[hull.neighbors]
    # Not those between triangles of one plane, which can be many at one corner.
    bent = np.abs(beside - hull.equations[:, None]).max(axis=2) > 1e-9
    # The neighbour k of a triangle is opposite to its corner k.
    edges = hull.simplices[:, [[1, 2], [2, 0], [0, 1]]][bent].astype(np.int64)
    return np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0)


@lru_cache(maxsize=16)
def ground_of(job: DropJob) -> Ground:
    """Return what the part of a job touches, for the kernel."""
    scale = job.time_unit / job.radius
    scene = job.scene
    planes = np.array([_plane(job, space) for space in scene.half_spaces])
    return Ground(
        planes=planes,
        gravity=job.scene.down,
        carriers=scene.velocities() * scale,
        motion=_motion(job),
        level=scene.level,
        endless=scene.free,
        driven=scene.driven,
        fastest=job.max_speed,
    )


def _plane(job: DropJob, space: HalfSpace) -> Array:
    """Return the columns of a plane, in R and T."""
    row, normal, contact = np.zeros(kernel_data.PLANE), space.normal, space.contact
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    across /= np.linalg.norm(across)
    row[:9] = np.concatenate([normal, np.cross(across, normal), across])
    row[kernel_data.OFFSET] = space.offset / job.radius
    row[kernel_data.RESTITUTION], row[kernel_data.FRICTION] = contact.restitution, contact.friction
    row[kernel_data.ROLL] = contact.rolling_friction * job.rolling_length
    row[kernel_data.SPIN] = job.conditions.spinning_friction
    scale = job.time_unit / job.radius
    row[kernel_data.CARRIES : kernel_data.CARRIES + 3] = space.velocity * scale
    return row


def _motion(job: DropJob) -> Array:
    """Return the numbers of the motion of the surfaces, in R and T."""
    numbers = np.zeros(kernel_data.MOTION)
    motion = job.motion
    if motion is None:
        return numbers
    unit, radius = job.time_unit, job.radius
    numbers[kernel_data.RATE] = 2 * np.pi * motion.frequency * unit
    numbers[kernel_data.RAMP] = RAMP_PERIODS / motion.frequency / unit
    numbers[kernel_data.DURATION] = motion.duration / unit
    numbers[kernel_data.SHIFT_PHASE] = motion.horizontal_phase
    numbers[kernel_data.ROCK_PHASE] = motion.rocking_phase
    vectors = np.array(
        [
            [0.0, 0.0, motion.vertical_amplitude / radius],
            [motion.horizontal_amplitude / radius, 0.0, 0.0],
            [motion.rocking_x, motion.rocking_y, 0.0],
        ]
    )
    if job.scene.level:
        numbers[kernel_data.SIZE] = motion.plate_size / radius
    numbers[kernel_data.LIFT :] = job.scene.in_scene(vectors).ravel()
    return numbers


# -- Compiled code --------------------------------------------------------------------------------


NAME = 'simulate_drops'
SOURCES = ('kernel.py', 'kernel_data.py')
# That of Numba: addresses can be anywhere. With "default", a process ends if the memory that its
# sections get is more than 2 GiB apart, as in a process that uses a GPU.
CODE_MODEL = 'jitdefault'
_lock = threading.Lock()


def simulate(
    body: Body,
    ground: Ground,
    numerics: Numerics,
    limit: Array | float,
    states: States,
    ends: Array,
    codes: Indices,
) -> None:
    """Simulate drops from their states until each has ended; see kernel.simulate.

    The lock of the interpreter is released meanwhile.
    """
    work = work_of(body, ground)
    limits = np.full(len(ends), limit, dtype=np.float64)
    given = tuple(np.ascontiguousarray(each) for each in states)
    arguments = (body, ground, numerics, work, limits, given, ends, codes)
    types = ' '.join(_types(arguments))
    with _lock:
        function = _loaded(types) or _built(types, arguments)
    # Where Numba's functions return a value and an exception, of which there are none.
    nothing, error = ctypes.c_void_p(), ctypes.c_void_p()
    function(ctypes.byref(nothing), ctypes.byref(error), *_flat(arguments))


def _types(value: Any) -> Iterator[str]:
    """Yield a description of each number and array of nested tuples."""
    if isinstance(value, tuple):
        for each in value:
            yield from _types(each)
    elif isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise ValueError('invalid array: expected a contiguous one')
        yield f'{value.dtype.str}{value.ndim}'
    else:
        yield type(value).__name__


def _flat(value: Any) -> Iterator[Any]:
    """Yield the arguments of a function of Numba: numbers, and of arrays the parts of a struct."""
    if isinstance(value, tuple):
        for each in value:
            yield from _flat(each)
    elif isinstance(value, np.ndarray):
        yield from (ctypes.c_void_p(), ctypes.c_void_p())
        yield from (ctypes.c_int64(value.size), ctypes.c_int64(value.itemsize))
        yield ctypes.c_void_p(value.ctypes.data)
        yield from (ctypes.c_int64(each) for each in (*value.shape, *value.strides))
    elif isinstance(value, bool):
        yield ctypes.c_int8(value)
    elif isinstance(value, int):
        yield ctypes.c_int64(value)
    else:
        yield ctypes.c_double(value)


@cache
def _file(types: str) -> str:
    """Return the name of the file of this processor, these sources and versions."""
    folder = Path(__file__).parent
    digest = hashlib.sha256(types.encode())
    for name in SOURCES:
        digest.update((folder / name).read_bytes())
    versions = [version(each) for each in ('numba', 'llvmlite')]
    for each in (*versions, CODE_MODEL, platform.machine(), _processor(), _features()):
        digest.update(each.encode())
    return f'kernel-{digest.hexdigest()[:16]}.o'


def _folders() -> tuple[Path, ...]:
    """Return where the file can be: beside the sources, or in the cache of the user."""
    caches = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(__file__).parent / '__pycache__', Path(caches) / 'resting_aspects_ros'


_functions: dict[str, Any] = {}
_engines: list[Any] = []


def _loaded(types: str) -> Any:
    """Return the function for arguments of these types; None if it was not compiled yet."""
    if types not in _functions:
        for folder in _folders():
            with suppress(OSError):
                _functions[types] = _function((folder / _file(types)).read_bytes())
                break
    return _functions.get(types)


@cache
def _machine() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(
        cpu=_processor(),
        features=_features(),
        opt=3,
        reloc='static' if target.name.startswith('x86') else 'default',
        codemodel=CODE_MODEL,
    )


def _processor() -> str:
    return str(llvm.get_host_cpu_name())


def _features() -> str:
    return str(llvm.get_host_cpu_features().flatten())


def _function(code: bytes) -> Any:
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(''), _machine())
    engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)  # which owns the code
    return ctypes.CFUNCTYPE(ctypes.c_int32)(engine.get_function_address(NAME))


def _built(types: str, arguments: tuple[Any, ...]) -> Any:
    """Compile the function for these arguments, and keep it in a file if that is possible."""
    text = 'compiling the simulation for this machine, which takes about 20 s once ...'
    print(text, file=sys.stderr, flush=True)
    from numba import typeof

    from resting_aspects_ros.simulation import kernel

    signature = tuple(map(typeof, arguments))
    kernel.simulate.compile(signature)
    name = kernel.simulate.overloads[signature].fndesc.llvm_func_name
    module = llvm.parse_assembly(kernel.simulate.inspect_llvm(signature).replace(name, NAME))
    for each in module.functions:
        if not each.is_declaration and each.name != NAME:
            each.linkage = 'internal'
    # Without what only Python needs to call the function.
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(_machine(), llvm.create_pipeline_tuning_options()))
    code = _machine().emit_object(module)
    for folder in _folders():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with NamedTemporaryFile(dir=folder, delete=False) as file:
                file.write(code)
            Path(file.name).chmod(0o644)
            Path(file.name).replace(folder / _file(types))
        except OSError:
            continue
        break
    _functions[types] = _function(code)
    return _functions[types]
