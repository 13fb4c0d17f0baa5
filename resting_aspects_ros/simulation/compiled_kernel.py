"""The compiled kernel: its machine code is kept in a file, which needs no Numba to be loaded.

Importing Numba and preparing a call takes 0.7 s of processor time, loading the file 0.03 s.
"""

import ctypes
import hashlib
import os
import platform
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import llvmlite.binding as llvm
import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.simulation import kernel_data
from resting_aspects_ros.simulation.kernel_data import Body, Ground, Numerics, States, work_of

NAME = 'simulate_drops'
SOURCES = ('kernel.py', 'kernel_data.py')
_lock = threading.Lock()


def simulate(
    body: Body,
    ground: Ground,
    numerics: Numerics,
    limit: Array | float,
    states: States,
    ends: Array,
    codes: npt.NDArray[np.int64],
) -> npt.NDArray[np.int64]:
    """Simulate drops from their states until each has ended; see kernel.simulate.

    The lock of the interpreter is released meanwhile. Returns (4,) int, the numbers of steps,
    impacts, steps of lasting contact and iterations.
    """
    work = work_of(body, ground)
    limits = np.full(len(ends), limit, dtype=np.float64)
    given = (np.ascontiguousarray(each) for each in states)
    arguments = (body, ground, numerics, work, limits, *given, ends, codes)
    types = ' '.join(_types(arguments))
    with _lock:
        function = _loaded(types) or _built(types, arguments)
    # Where Numba's functions return a value and an exception, of which there are none.
    nothing, error = ctypes.c_void_p(), ctypes.c_void_p()
    function(ctypes.byref(nothing), ctypes.byref(error), *_flat(arguments))
    return np.asarray(work.counts[:4], dtype=np.int64)


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
    folder = Path(kernel_data.__file__).parent
    digest = hashlib.sha256(types.encode())
    for name in SOURCES:
        digest.update((folder / name).read_bytes())
    versions = [version(each) for each in ('numba', 'llvmlite')]
    for each in (*versions, platform.machine(), _processor(), _features()):
        digest.update(each.encode())
    return f'kernel-{digest.hexdigest()[:16]}.o'


def _folders() -> tuple[Path, ...]:
    """Return where the file can be: beside the sources, or in the cache of the user."""
    caches = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(kernel_data.__file__).parent / '__pycache__', Path(caches) / 'resting_aspects_ros'


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
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=_processor(), features=_features(), opt=3, reloc='pic', codemodel='default'
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
