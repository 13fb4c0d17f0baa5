"""Damages input files of every kind and loads them: python -m fuzz.inputs [--files N] [--seed S].

Prints each exception other than a RestingAspectsError with a message of one line, each warning of
a number that overflows, each crash, and each file that takes more than LIMIT seconds of processor
time. The exit code is 1 if there is any. The same seed damages the same files in the same way.
"""

import argparse
import json
import os
import random
import re
import resource
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from fuzz.input_kinds import Kind, made_kinds
from resting_aspects_ros.errors import RestingAspectsError

LIMIT = 20  # s of processor time for one file; most take milliseconds
MEMORY = 8 << 30  # bytes of address space
# Texts that replace a word, a number or a cell, and values that replace one of a document.
ODD = (
    ' x nan -inf 1e999 0 -1 2 0x1f 1_0 true null [] {} [1] {a:1} "1" ~ 2020-01-01 .inf 1:2:3 \t '
    f'&a[*a] \0 \ud800 é ٣ ² !!binary ../x /dev/zero {"9" * 25} {"9" * 400} -{"9" * 5000}'
).split(' ')
VALUES: list[Any] = [
    *(None, True, 0, 1, -1, 2, 0.5, -1e-9, 1e300, -1e300, 5e-324, 2**31, 2**63, 10**400),
    *(float('nan'), float('inf'), '', 'x', '60 mm', '1', '\0', '1:2:0', 'a' * 5000, [], {}, [1]),
    *([[1]], {'a': 1}, {'kind': 'slope'}, [1, 2, 3], [0] * 4, [1e300] * 3, ['x', None], [None]),
]


def damaged(data: bytes, suffix: str, rng: random.Random) -> bytes:
    """Return the bytes with one to three defects."""
    ways = [flipped, cut, other_lines, replaced, replaced, encoded]
    if suffix in ('.yaml', '.json'):
        ways += [changed_value] * 8
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


def other_lines(data: bytes, rng: random.Random) -> bytes:
    """Remove a line, or repeat it, so that a key or a row occurs several times."""
    lines = data.splitlines(keepends=True) or [b'']
    k = rng.randrange(len(lines))
    return b''.join([*lines[:k], lines[k] * rng.choice((0, 2, 3)), *lines[k + 1 :]])


def replaced(data: bytes, rng: random.Random) -> bytes:
    """Replace, remove or repeat a number, a word or a cell."""
    pattern = rng.choice((rb'-?\d+(\.\d+)?', rb'[\w.+-]+', rb'[^,;\n]+,?'))
    found = list(re.finditer(pattern, data[:100_000]))
    if not found:
        return data
    match = rng.choice(found)
    new = rng.choice((*ODD, '')).encode('utf-8', 'surrogatepass')
    return data[: match.start()] + rng.choice((new, new, match[0] * 2)) + data[match.end() :]


def encoded(data: bytes, rng: random.Random) -> bytes:
    """Write the text in another encoding, with tabs, with binary bytes or without content."""
    codec = rng.choice(('utf-16', 'utf-32-le', 'latin-1', 'utf-8-sig', 'tabs', 'binary', ''))
    if codec == 'tabs':
        return data.replace(b'  ', b'\t')
    if codec == 'binary':
        return rng.randbytes(20) + data
    return (data.decode('utf-8', 'replace') + 'é').encode(codec, 'replace') if codec else b''


def changed_value(data: bytes, rng: random.Random) -> bytes:
    """Replace, remove, rename, repeat or nest a value of a YAML or JSON document."""
    is_json = data.lstrip()[:1] == b'{'
    try:
        document = [json.loads(data) if is_json else yaml.safe_load(data)]
        holder, key = rng.choice(list(_places(document)))
        old = holder.pop(key)
        if isinstance(holder, list):
            holder.insert(key, old)
        deep: Any = old
        for _ in range(30):
            deep = [deep]
        new = rng.choice(VALUES)
        if rng.random() < 0.4:
            new = rng.choice(({'a': old}, [old], [old, old], [old] * 40, deep))
        name = rng.choice((key, key, key, 'name', 'unit')) if isinstance(holder, dict) else key
        if rng.random() < 0.85:
            holder[name] = new
        text = json.dumps(document[0]) if is_json else yaml.safe_dump(document[0])
    except (ValueError, RecursionError, TypeError, yaml.YAMLError):  # it is damaged already
        return flipped(data, rng)
    return str(text).encode('utf-8', 'surrogatepass')


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield each container with each of its keys."""
    for key, each in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(each, dict | list):
            yield from _places(each)


def finding(kind: Kind, path: Path) -> str:
    """Load a file in a forked process; return what is wrong with how it was loaded, or ''."""
    reader, writer = os.pipe()
    if (child := os.fork()) == 0:
        for what, limit in (('CPU', LIMIT), ('AS', MEMORY), ('CORE', 0)):
            resource.setrlimit(getattr(resource, f'RLIMIT_{what}'), (limit, limit))
        os.write(writer, _problem(kind, path).encode('utf-8', 'backslashreplace'))
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, 'rb') as file:
        text = file.read().decode()
    status = os.waitpid(child, 0)[1]
    return f'ended by signal {os.WTERMSIG(status)}' if os.WIFSIGNALED(status) else text


def _problem(kind: Kind, path: Path) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            warnings.simplefilter('error', RuntimeWarning)
            kind.load(path)
    except RestingAspectsError as error:
        text = str(error)
        return '' if text.isprintable() and len(text) < 3000 else f'message {text[:100]!r}'
    except BaseException as error:  # noqa: BLE001 what this script looks for
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f'{Path(last.filename).name}:{last.lineno}'
        return f'{type(error).__name__} in {where}: {str(error)[:80]!r}'
    return ''


def findings(kinds: dict[str, Kind], folder: Path, files: int, seed: int) -> Iterator[str]:
    """Yield a description of each file that is not loaded as it should be; kinds take turns.

    The file remains in the folder as <kind>_<number>.
    """
    for number in range(files):
        name = sorted(kinds)[number % len(kinds)]
        kind, rng = kinds[name], random.Random(f'{seed} {number}')
        path = folder / kind.file
        path.write_bytes(damaged(rng.choice(kind.seeds), path.suffix, rng))
        if problem := finding(kind, path):
            path.rename(folder / f'{name}_{number}{path.suffix}')
            yield f'{name} {number}: {problem}'
        path.unlink(missing_ok=True)


def main() -> int:
    """Print each finding; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--files', type=int, default=1000)
    parser.add_argument('--seed', type=int, default=1)
    given = parser.parse_args()
    folder = Path(tempfile.mkdtemp())
    kinds, count = made_kinds(folder), 0
    for text in findings(kinds, folder, given.files, given.seed):
        count += 1
        print(text, flush=True)
    print(f'{given.files} files of {len(kinds)} kinds in {folder}: {count} findings')
    return 1 if count else 0


if __name__ == '__main__':
    sys.exit(main())
