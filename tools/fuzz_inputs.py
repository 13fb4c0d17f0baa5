"""Damages input files of every kind and loads them: fuzz_inputs.py [--files N] [--seed S].

Any exception other than a RestingAspectsError with a message of one line, any warning about
numbers, and any file that takes more than LIMIT seconds of processor time is printed as a finding.
The exit code is 1 if there is any. The same seed damages the same files in the same way.
"""

import argparse
import copy
import json
import os
import random
import re
import resource
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml
from input_kinds import Kind, made_kinds

from resting_aspects_ros.core.errors import RestingAspectsError

LIMIT = 20  # s of processor time for one file; most take milliseconds
MEMORY = 8 << 30  # bytes of address space
ODD = (
    *('', 'x', ' ', 'nan', '-inf', '1e999', '1e-320', '0', '-1', '2', '10**9', '0x1f', '1_0'),
    *('true', 'null', '[]', '{}', '[1]', '{a: 1}', '[[1], [2, 3]]', '"1"', '~', '2020-01-01'),
    *('9' * 25, '9' * 400, '-' + '9' * 400, '9' * 5000, '.inf', '.nan', '1:2:3', '&a [*a]', '\t'),
    *(
        '\0',
        '\ud800',
        'é',
        '٣',
        '²',
        '!!python/name:os.system',
        '!!binary x',
        '../../x',
        '/dev/zero',
    ),
)
VALUES = (
    *(None, True, False, 0, 1, -1, 2, 0.5, -1e-9, 1e300, -1e300, 1e-300, 5e-324, 10**9, 2**31),
    *(2**63, 10**30, 10**400, float('nan'), float('inf'), -float('inf'), '', 'x', '60 mm', '1'),
    *('\0', '\ud800', '1:2:0', 'a' * 5000, [], {}, [1], [[1]], {'a': 1}, {'kind': 'slope'}),
    *([0, 0, 0], [1, 2, 3], [0, 0, 0, 0], [1e300] * 3, ['x', None], {1: 2}, [[]], [None]),
)


def damaged(data: bytes, suffix: str, rng: random.Random) -> bytes:
    """Return the bytes with one to three defects."""
    ways = [flipped, cut, doubled, swapped_number, odd_token, encoded, without_line]
    if suffix in ('.yaml', '.json'):
        ways += [changed_document] * 12
    if suffix == '.csv':
        ways += [changed_cell] * 6
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = rng.choice(ways)(data, rng)
    return data


def flipped(data: bytes, rng: random.Random) -> bytes:
    """Change some bytes."""
    found = bytearray(data)
    for _ in range(rng.choice((1, 2, 10)) if found else 0):
        found[rng.randrange(len(found))] = rng.randrange(256)
    return bytes(found)


def cut(data: bytes, rng: random.Random) -> bytes:
    """Remove the end, or a piece of at most 50 bytes."""
    k = rng.randrange(len(data) + 1)
    return data[:k] if rng.random() < 0.4 else data[:k] + data[k + rng.randrange(50) :]


def doubled(data: bytes, rng: random.Random) -> bytes:
    """Repeat a line, so that a key or a row occurs twice."""
    lines = data.splitlines(keepends=True) or [b'']
    k = rng.randrange(len(lines))
    return b''.join([*lines[:k], lines[k] * rng.choice((2, 3)), *lines[k + 1 :]])


def without_line(data: bytes, rng: random.Random) -> bytes:
    """Remove a line."""
    lines = data.splitlines(keepends=True) or [b'']
    k = rng.randrange(len(lines))
    return b''.join(lines[:k] + lines[k + 1 :])


def swapped_number(data: bytes, rng: random.Random) -> bytes:
    """Replace a number by an odd text."""
    return _replaced(data, rb'-?\d+(\.\d+)?', rng)


def odd_token(data: bytes, rng: random.Random) -> bytes:
    """Replace a word by an odd text."""
    return _replaced(data, rb'[\w.+-]+', rng)


def _replaced(data: bytes, pattern: bytes, rng: random.Random) -> bytes:
    found = list(re.finditer(pattern, data[:100_000]))
    if not found:
        return data
    match = rng.choice(found)
    new = rng.choice(ODD).encode('utf-8', 'surrogatepass')
    return data[: match.start()] + new + data[match.end() :]


def encoded(data: bytes, rng: random.Random) -> bytes:
    """Write the text in another encoding, without content or with binary bytes in front."""
    text = data.decode('utf-8', 'replace')
    encoding = rng.choice(('utf-16', 'utf-32-le', 'latin-1', 'utf-8-sig', '', 'tabs', 'binary'))
    special = {
        '': b'',
        'tabs': data.replace(b'  ', b'\t'),
        'binary': bytes(rng.randrange(256) for _ in range(20)) + data,
    }
    return special[encoding] if encoding in special else (text + 'é').encode(encoding, 'replace')


def changed_cell(data: bytes, rng: random.Random) -> bytes:
    """Replace, remove or repeat a cell of a CSV."""
    lines = data.splitlines() or [b'']
    row = rng.choice((0, rng.randrange(len(lines))))
    cells = lines[row].split(b',')
    k = rng.randrange(len(cells))
    new = rng.choice(ODD).encode('utf-8', 'surrogatepass')
    cells[k : k + 1] = rng.choice(([new], [], [cells[k]] * 2))
    return b'\n'.join([*lines[:row], b','.join(cells), *lines[row + 1 :]])


def changed_document(data: bytes, rng: random.Random) -> bytes:
    """Replace, remove, rename, repeat or nest a value of a YAML or JSON document."""
    is_json = data.lstrip()[:1] == b'{'
    try:
        document = [json.loads(data) if is_json else yaml.safe_load(data)]
        places = list(_places(document))
    except (ValueError, RecursionError, TypeError, yaml.YAMLError):
        return flipped(data, rng)
    holder, key = rng.choice(places)
    way = rng.choice(('value', 'value', 'value', 'remove', 'rename', 'nest', 'list', 'deep'))
    if way == 'remove':
        del holder[key]
    elif way == 'rename' and isinstance(holder, dict):
        holder[rng.choice(('x', 'name', 'kind', 'unit'))] = holder.pop(key)
    elif way == 'deep':
        for _ in range(rng.choice((30, 3000)) if is_json else 30):
            holder[key] = [holder[key]]
    else:
        new = copy.deepcopy(rng.choice(VALUES))
        changed = {'nest': {'a': holder[key]}, 'list': [holder[key]] * rng.choice((1, 2, 40))}
        holder[key] = changed.get(way, new)
    try:
        text = _text(document[0] if document else None, is_json)
    except (ValueError, RecursionError, TypeError, yaml.YAMLError):
        return flipped(data, rng)
    return text.encode('utf-8', 'surrogatepass')


def _text(document: Any, is_json: bool) -> str:
    return json.dumps(document) if is_json else str(yaml.safe_dump(document, allow_unicode=True))


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield each container with each of its keys."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, each in list(items):
        yield value, key
        if isinstance(each, dict | list):
            yield from _places(each)


def finding(load: Callable[[Path], object], path: Path) -> str | None:
    """Load a file in a forked process; return what is wrong with how it was loaded, or None.

    The process has limits of time and memory, and its crash is a finding, too.
    """
    reader, writer = os.pipe()
    if (child := os.fork()) == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.write(writer, (_problem(load, path) or '').encode('utf-8', 'backslashreplace'))
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, 'rb') as file:
        text = file.read().decode()
    status = os.waitpid(child, 0)[1]
    return f'ended by signal {os.WTERMSIG(status)}' if os.WIFSIGNALED(status) else text or None


def _problem(load: Callable[[Path], object], path: Path) -> str | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            warnings.simplefilter('error', RuntimeWarning)
            load(path)
    except RestingAspectsError as error:
        text = str(error)
        return None if text.isprintable() and len(text) < 3000 else f'message {text[:100]!r}'
    except BaseException as error:  # noqa: BLE001 what this script looks for
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f'{Path(last.filename).name}:{last.lineno}'
        return f'{type(error).__name__} in {where}: {str(error)[:80]!r}'
    return None


def findings(
    kinds: dict[str, Kind], folder: Path, files: int, seed: int
) -> Iterator[tuple[str, int, str, bytes]]:
    """Yield kind, number, finding and content of each file that is not loaded as it should be.

    The kinds take turns.
    """
    names = sorted(kinds)
    for number in range(files):
        name = names[number % len(names)]
        kind = kinds[name]
        rng = random.Random(f'{seed} {number}')
        data = damaged(rng.choice(kind.seeds), Path(kind.file).suffix, rng)
        path = folder / kind.file
        path.write_bytes(data)
        problem = finding(kind.load, path)
        path.unlink()
        if problem is not None:
            yield name, number, problem, data


def main() -> int:
    """Print each finding; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--files', type=int, default=1000)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--only', default='', help='part of the name of a kind')
    parser.add_argument('--keep', type=Path, help='folder for the files of the findings')
    given = parser.parse_args()
    count = 0
    with tempfile.TemporaryDirectory() as name:
        kinds = made_kinds(Path(name))
        kinds = {key: kind for key, kind in kinds.items() if given.only in key}
        for kind, number, problem, data in findings(kinds, Path(name), given.files, given.seed):
            count += 1
            print(f'{kind} {number}: {problem}', flush=True)
            if given.keep is not None:
                given.keep.mkdir(parents=True, exist_ok=True)
                file = given.keep / f'{number}_{kind}{Path(kinds[kind].file).suffix}'
                file.write_bytes(data)
    print(f'{given.files} files of {len(kinds)} kinds: {count} findings')
    return 1 if count else 0


if __name__ == '__main__':
    sys.exit(main())
