"""Natural resting aspects of parts, by simulated drops: Python interface, command and ROS nodes.

>>> import resting_aspects_ros as ra
>>> part = ra.load_part('l_bracket')
>>> result = ra.drop(part, drops=200, surface='rubber_mat', seed=1)
>>> result.distribution.drops
200

The names below are imported when they are first used, because nodes and worker processes import
this package, too.
"""

from importlib import import_module
from typing import Any

__version__ = '0.1.0'

_MODULES = {
    'ClassificationResult': 'api.classify',
    'ComparisonResult': 'api.compare',
    'DropConditions': 'simulation.conditions',
    'DropResult': 'api.drop_result',
    'EngineError': 'core.errors',
    'EstimateResult': 'api.estimate',
    'GivenStates': 'simulation.starts',
    'InvalidValueError': 'core.errors',
    'Kick': 'simulation.impulses',
    'LogError': 'core.errors',
    'NamedAction': 'simulation.actions',
    'Noise': 'simulation.noise',
    'NotDefinedError': 'core.estimators.resting_shape',
    'Nozzle': 'simulation.nozzle',
    'Part': 'core.part',
    'PartError': 'core.errors',
    'PlanResult': 'api.reorient_plan',
    'ReorientResult': 'api.reorient_result',
    'RestingAspectsError': 'core.errors',
    'RestingAspectsWarning': 'core.errors',
    'RetentionResult': 'api.retention',
    'Step': 'simulation.step_action',
    'UnknownPartError': 'core.errors',
    'Vibration': 'simulation.vibration',
    'classify': 'api.classify',
    'compare': 'api.compare',
    'drop': 'api.drop',
    'estimate': 'api.estimate',
    'find_aspects': 'core.aspects.aspect',
    'load_part': 'api.load_part',
    'plan_reorientation': 'api.reorient_plan',
    'read_log': 'api.read_log',
    'reorient': 'api.reorient',
    'retention': 'api.retention',
}
__all__ = sorted(_MODULES)  # noqa: PLE0605 a list, but ruff cannot see it


def __getattr__(name: str) -> Any:
    """Import a public name; raises AttributeError for any other."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)


def __dir__() -> list[str]:
    return [*globals(), *_MODULES]
