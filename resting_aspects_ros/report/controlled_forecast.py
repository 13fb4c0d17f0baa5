"""A forecast with feeder_controller as a sentence and as fields of a document."""

from typing import Any

from resting_aspects_ros.feeding.tray_simulation import ControlledRuns
from resting_aspects_ros.report.rounding import minutes_text, number_text


def controlled_text(found: ControlledRuns) -> str:
    """Return 'with feeder_controller: 33.5 parts per minute (29.8 to 36.2 in 5 minutes)'."""
    low, high = map(number_text, found.prediction)
    return (
        f'with feeder_controller: {number_text(found.rate)} parts per minute '
        f'({low} to {high} in {minutes_text(found.minutes)})'
    )


def controlled_fields(found: ControlledRuns) -> dict[str, Any]:
    """Return the fields of a document; rates are parts per minute."""
    low, high = found.prediction
    return {
        'parts_per_minute': found.rate,
        'lower': found.lower,
        'upper': found.upper,
        'prediction_minutes': found.minutes,
        'prediction_lower': low,
        'prediction_upper': high,
    }
