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
    'CalibrationResult': 'studies.calibration.result',
    'BatchResult': 'studies.batch',
    'ClassificationResult': 'api.classify',
    'ComparisonResult': 'api.compare',
    'ControlledRuns': 'core.feeding.controlled_runs',
    'DriftResult': 'api.drift',
    'DropConditions': 'simulation.conditions',
    'DropResult': 'api.drop_result',
    'EngineError': 'core.errors',
    'EstimateResult': 'api.estimate',
    'Footprint': 'core.feeding.footprint',
    'ForecastResult': 'api.forecast_result',
    'GivenStates': 'simulation.starts',
    'Grasp': 'core.vision.grasp',
    'Identification': 'core.vision.identification',
    'InvalidValueError': 'core.errors',
    'Kick': 'simulation.impulses',
    'KnownPart': 'core.vision.known_part',
    'LiveCounts': 'core.statistics.counted_parts',
    'LogError': 'core.errors',
    'MachineTransitions': 'api.measured_trials',
    'NamedAction': 'simulation.actions',
    'Noise': 'simulation.noise',
    'NotDefinedError': 'core.estimators.estimate',
    'Nozzle': 'simulation.nozzle',
    'OptimiseResult': 'studies.optimum',
    'OutlineNoise': 'core.vision.likelihood',
    'OutlinesResult': 'api.outlines',
    'Part': 'core.part',
    'PartError': 'core.errors',
    'Pinhole': 'core.vision.camera',
    'PlanResult': 'api.reorient_result',
    'PropagatedResult': 'studies.propagate',
    'ReorientResult': 'api.reorient_result',
    'RestingAspectsError': 'core.errors',
    'RestingAspectsWarning': 'core.errors',
    'RetentionResult': 'api.retention',
    'Step': 'simulation.step_action',
    'Telecentric': 'core.vision.camera',
    'StudyResult': 'studies.study',
    'Surroundings': 'simulation.surroundings.description',
    'UnknownPartError': 'core.errors',
    'Vibration': 'simulation.vibration',
    'calibrate': 'studies.calibration.calibrate',
    'classify': 'api.classify',
    'compare': 'api.compare',
    'drop': 'api.drop',
    'drop_batch': 'studies.batch',
    'estimate': 'api.estimate',
    'find_aspects': 'core.aspects.aspect',
    'find_homography': 'core.vision.homography',
    'forecast': 'api.forecast',
    'forecast_controlled': 'api.forecast',
    'gripper_poses': 'core.vision.grasp',
    'identify_part': 'api.identify',
    'known_part': 'api.identify',
    'load_grasps': 'api.grasps',
    'load_part': 'api.load_part',
    'locate_part': 'api.identify',
    'machine_transitions': 'api.measured_trials',
    'optimise': 'studies.optimise',
    'outlines': 'api.outlines',
    'parts_needed': 'core.statistics.drift',
    'plan_reorientation': 'api.reorient_result',
    'propagate': 'studies.propagate',
    'read_log': 'api.drop',
    'reorient': 'api.reorient',
    'retention': 'api.retention',
    'study': 'studies.study',
    'surroundings': 'api.surroundings',
    'transformed_pose': 'core.vision.camera',
    'watch_drift': 'api.drift',
}
__all__ = sorted(_MODULES)  # noqa: PLE0605 a list, but ruff cannot see it


def __getattr__(name: str) -> Any:
    """Import a public name; raises AttributeError for any other."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)


def __dir__() -> list[str]:
    return [*globals(), *_MODULES]
