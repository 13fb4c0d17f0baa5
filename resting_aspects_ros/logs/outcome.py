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


def is_whole(folder: Path) -> bool:
    """Whether the log in a folder holds all drops of its run, as its metadata.yaml says."""
    return custom_data(folder).get(f'{OUTCOME}.whole') == 'true'
