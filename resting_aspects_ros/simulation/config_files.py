"""Location of the suite's configuration files, in the source tree or installed."""

from pathlib import Path

PACKAGE = 'resting_aspects_ros'


def config_folder() -> Path:
    """Return the folder config of the source tree if there is one, otherwise the installed one."""
    here = Path(__file__).resolve()
    root = here.parents[2]
    source = root / 'config'
    if source.is_dir() and (root / 'package.xml').is_file():
        return source
    for parent in here.parents:
        installed = parent / 'share' / PACKAGE / 'config'
        if installed.is_dir():
            return installed
    raise FileNotFoundError(f'the folder config of {PACKAGE} is not installed near {here}')


def parts_folder() -> Path:
    """Return the folder of the example parts."""
    return config_folder() / 'parts'


def surfaces_file() -> Path:
    """Return the file of the named conditions."""
    return config_folder() / 'surfaces.yaml'


def actions_file() -> Path:
    """Return the file of the named actions."""
    return config_folder() / 'actions.yaml'


def surroundings_folder() -> Path:
    """Return the folder of the named surroundings."""
    return config_folder() / 'surroundings'
