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
    'CalibrationResult': 'studies.calibration.calibrate',
    'BatchResult': 'studies.batch',
    'ClassificationResult': 'api.classify',
    'ComparisonResult': 'api.compare',
    'ControlledRuns': 'feeding.tray_simulation',
    'DriftResult': 'api.compare',
    'DropConditions': 'simulation.conditions',
    'DropResult': 'api.drop',
    'EngineError': 'errors',
    'EstimateResult': 'api.estimate',
    'Footprint': 'feeding.footprint',
    'ForecastResult': 'api.forecast_result',
    'GivenStates': 'simulation.starts',
    'Grasp': 'feeding.grasps',
    'Identification': 'vision.identification',
    'InvalidValueError': 'errors',
    'Kick': 'simulation.actions',
    'KnownPart': 'vision.rolling',
    'LiveCounts': 'statistics.counted_parts',
    'LogError': 'errors',
    'MachineTransitions': 'api.compare',
    'NamedAction': 'simulation.actions',
    'Noise': 'simulation.conditions',
    'NotDefinedError': 'aspects.estimate',
    'Nozzle': 'simulation.actions',
    'OptimiseResult': 'studies.optimum',
    'OutlineNoise': 'vision.fitting',
    'OutlinesResult': 'api.outlines',
    'Part': 'part.part',
    'PartError': 'errors',
    'Pinhole': 'vision.camera',
    'PlanResult': 'api.reorient',
    'ReorientResult': 'api.reorient',
    'RestingAspectsError': 'errors',
    'RestingAspectsWarning': 'errors',
    'RetentionResult': 'api.retention',
    'Track': 'tracks.description',
    'TrackResult': 'api.track_result',
    'Step': 'simulation.actions',
    'Telecentric': 'vision.camera',
    'StoppedError': 'errors',
    'StudyResult': 'studies.study',
    'Surroundings': 'simulation.surroundings',
    'UnknownPartError': 'errors',
    'Vibration': 'simulation.actions',
    'calibrate': 'studies.calibration.calibrate',
    'classify': 'api.classify',
    'compare': 'api.compare',
    'drop': 'api.drop',
    'drop_batch': 'studies.batch',
    'estimate': 'api.estimate',
    'find_aspects': 'aspects.find',
    'find_homography': 'vision.camera',
    'forecast': 'api.forecast',
    'forecast_controlled': 'api.forecast',
    'gripper_poses': 'feeding.grasps',
    'identify_part': 'api.identify',
    'known_part': 'api.identify',
    'load_grasps': 'feeding.grasps',
    'load_part': 'part.library',
    'locate_part': 'api.identify',
    'machine_transitions': 'api.compare',
    'optimise': 'studies.optimise',
    'outlines': 'api.outlines',
    'parts_needed': 'statistics.drift',
    'plan_reorientation': 'api.reorient',
    'read_log': 'api.drop',
    'reorient': 'api.reorient',
    'repeat_log': 'api.drop',
    'retention': 'api.retention',
    'track': 'api.track',
    'design_track': 'api.track',
    'study': 'studies.study',
    'surroundings': 'api.conditions',
    'transformed_pose': 'vision.camera',
    'watch_drift': 'api.compare',
}
__all__ = sorted(_MODULES)  # noqa: PLE0605 a list, but ruff cannot see it


def __getattr__(name: str) -> Any:
    """Import a public name; raises AttributeError for any other."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)


def __dir__() -> list[str]:
    return [*globals(), *_MODULES]
