"""Build resting_aspects_interfaces and install it into the virtual environment that runs this."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

VENV = Path(sys.prefix)
SOURCE = Path(__file__).resolve().parents[1] / 'resting_aspects_interfaces'
BUILD = VENV / 'interfaces'
INSTALLED = VENV / 'interfaces_manifest.txt'
LOG = VENV / 'interfaces.log'


def main() -> None:
    """Replace what an earlier build installed."""
    for file in VENV.glob('share/*/cmake/*Export.cmake'):
        drop_missing_include_folders(file)
    shutil.rmtree(BUILD, ignore_errors=True)  # types generated before would be installed too
    options = {
        'CMAKE_INSTALL_PREFIX': VENV,
        'CMAKE_PREFIX_PATH': VENV,
        'Python3_EXECUTABLE': VENV / 'bin' / 'python',
        'BUILD_TESTING': 'OFF',
    }
    LOG.unlink(missing_ok=True)
    cmake('-S', SOURCE, '-B', BUILD, '-G', 'Ninja', *(f'-D{k}={v}' for k, v in options.items()))
    cmake('--build', BUILD)
    if INSTALLED.exists():
        for name in INSTALLED.read_text().splitlines():
            Path(name).unlink(missing_ok=True)
    cmake('--install', BUILD)
    shutil.copy(BUILD / 'install_manifest.txt', INSTALLED)


def cmake(*arguments: str | Path) -> None:
    """Run CMake and end with the last lines of its log if it fails."""
    programs = VENV / 'bin'  # where CMake finds ninja
    path = f'{programs}{os.pathsep}{os.environ["PATH"]}'
    with LOG.open('a') as log:
        ended = subprocess.run(
            [programs / 'cmake', *arguments],
            env=os.environ | {'PATH': path},
            stdout=log,
            stderr=log,
            check=False,
        )
    if ended.returncode:
        end = '\n'.join(LOG.read_text(errors='replace').splitlines()[-20:])
        sys.exit(f'set-up: the interface package could not be built; the end of {LOG}:\n{end}')


def drop_missing_include_folders(file: Path) -> None:
    """Remove folders of the machine that built the wheel from the targets that a file exports.

    CMake refuses targets whose include folders do not exist. The file is replaced, since uv links
    it to its cache.
    """

    def existing(match: re.Match[str]) -> str:
        kept = [f for f in match[2].split(';') if f.startswith('$') or Path(f).exists()]
        return f'{match[1]}"{";".join(kept)}"'

    text = re.sub(r'(INTERFACE_INCLUDE_DIRECTORIES )"([^"]*)"', existing, file.read_text())
    file.unlink()
    file.write_text(text)


if __name__ == '__main__':
    main()
