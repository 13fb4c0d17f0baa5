"""The record of how a log ended: whether it holds all drops of its run and the part; how many."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from resting_aspects_ros.logs.bag_metadata import custom_data

OUTCOME = 'outcome'


@dataclass(frozen=True)
class Outcome:
    """Drops in a log, and whether it is whole: all drops of its run, and the part."""

    drops: int
    whole: bool

    def record(self) -> dict[str, str]:
        """The values of the record."""
        return {'whole': str(self.whole).lower(), 'drops': str(self.drops)}

    @classmethod
    def of(cls, notes: Mapping[str, Mapping[str, str]]) -> 'Outcome | None':
        """What the records of a log say; None if they do not."""
        values = notes.get(OUTCOME, {})
        drops = values.get('drops', '')
        if 'whole' not in values or not drops.isdecimal():
            return None
        return cls(int(drops), values['whole'] == 'true')


def recorded_outcome(folder: Path) -> Outcome | None:
    """What metadata.yaml says of the log in a folder; None if it does not."""
    custom = custom_data(folder)
    start = f'{OUTCOME}.'
    values = {key.removeprefix(start): value for key, value in custom.items()}
    return Outcome.of({OUTCOME: values})
