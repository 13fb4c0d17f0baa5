"""The result of a drift test, with its JSON document and picture."""

from dataclasses import dataclass
from pathlib import Path

from resting_aspects_ros.api.inputs.counts import CountedDrops
from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.core.statistics.live_counts import LiveCounts
from resting_aspects_ros.report.document import SCHEMA_VERSION, to_json
from resting_aspects_ros.report.drift_table import drift_fields
from resting_aspects_ros.report.drift_text import DriftWindows, drift_sentence


@dataclass(frozen=True, eq=False)
class DriftResult:
    """Counted parts beside the simulation, with the test of each window.

    Attributes
    ----------
    expected : CountedDrops
        The simulated drops by symmetry class.
    source : str
        The file of the counted parts.
    tested : DriftWindows
        The windows, their tests (``tested.test``), and the deviation of the drifted windows.
    live : LiveCounts
        All counted parts with the simulation as the prior.
    """

    expected: CountedDrops
    source: str
    tested: DriftWindows

    @property
    def live(self) -> LiveCounts:
        """All counted parts by symmetry class, with the simulation as the prior."""
        return self.tested.live

    @property
    def drift(self) -> bool:
        """Whether any window raises an alarm."""
        return len(self.tested.test.drifted) > 0

    @property
    def verdict(self) -> str:
        """A sentence: no drift, or which class deviates, by how much and since which part."""
        return drift_sentence(self.tested)

    @property
    def title(self) -> str:
        """The counted parts and the simulated drops, in one line."""
        return f'{self.live.parts} parts against {self.expected.title}'

    def to_json(self) -> str:
        """Return the JSON document that `resting_aspects drift --json` prints."""
        return to_json(
            {
                'schema_version': SCHEMA_VERSION,
                'file': self.source,
                'part': self.expected.part or None,
                'part_sha256': self.expected.part_sha256 or None,
                'expected': {
                    'file': self.expected.source,
                    'run_id': self.expected.run.run_id if self.expected.run else None,
                    'drops': self.expected.drops,
                },
                **drift_fields(self.tested),
            }
        )

    def save_json(self, path: Path) -> None:
        """Write the JSON document; raises OutputError."""
        with whole_file(path) as file:
            file.write_text(self.to_json(), encoding='utf-8')

    def save_picture(self, path: Path) -> None:
        """Write the shares in each window as PNG; raises OutputError."""
        # These imports take about a second.
        from resting_aspects_ros.report.drift_figure import drift_figure
        from resting_aspects_ros.report.figure_style import png_bytes

        with whole_file(path) as file:
            file.write_bytes(png_bytes(drift_figure(self.tested)))
