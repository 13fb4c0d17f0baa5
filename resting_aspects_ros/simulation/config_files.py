"""Where the suite's own files are: the folder config, in the source tree or installed."""

from pathlib import Path

PACKAGE = 'resting_aspects_ros'


def config_folder() -> Path:
    """The source tree's folder, if this is one; else the installed one above this file."""
    here = Path(__file__).resolve()
    root = here.parents[2]
    source = root / 'config'
    if source.is_dir() and (root / 'package.xml').is_file():
        return source
    for parent in here.parents:
        installed = parent / 'share' / PACKAGE / 'config'
        if installed.is_dir():
            return installed
    raise FileNotFoundError(f'the folder config of {PACKAGE} is not installed beside {here}')


def parts_folder() -> Path:
    """The example parts."""
    return config_folder() / 'parts'


def surfaces_file() -> Path:
    """The named conditions."""
    return config_folder() / 'surfaces.yaml'
