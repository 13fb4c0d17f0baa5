"""The result of an action on a part, with its report and pictures."""

from collections.abc import Sequence
from pathlib import Path

from resting_aspects_ros.api.counted_actions import CountedActions
from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.core.errors import InvalidValueError


class ReorientResult(CountedActions):
    """The transitions that an action causes, with the drops that replace parts that left.

    Its attributes are those of `CountedActions`.
    """

    def report(self, folder: str | Path, wanted: Sequence[int] = ()) -> Path:
        """Write a page with figures and all numbers into a folder, which is made if necessary.

        Returns the path of the page; raises OutputError if it cannot be written.
        """
        from resting_aspects_ros.api.reorientation_files import (
            check_reorientation_report,
            write_reorientation_report,
        )

        check_reorientation_report('folder', Path(folder), [self.action.name])
        return write_reorientation_report([self], Path(folder), wanted=wanted)

    def save_picture(self, path: str | Path) -> None:
        """Write the heat map of the transitions as PNG; raises OutputError."""
        from resting_aspects_ros.report.figure_style import png_bytes
        from resting_aspects_ros.report.transition_figure import transition_figure

        data = png_bytes(transition_figure(self.matrix, self.part, self.title))
        with whole_file(Path(path)) as part:
            part.write_bytes(data)

    def save_flow(self, path: str | Path) -> None:
        """Write the flow between the aspects in the long run as PNG; raises OutputError."""
        from resting_aspects_ros.report.figure_style import png_bytes
        from resting_aspects_ros.report.flow_figure import flow_figure

        if self.long_run is None:
            raise InvalidValueError('invalid result: expected actions from each aspect')
        data = png_bytes(flow_figure(self.matrix, self.long_run, self.part, self.title))
        with whole_file(Path(path)) as part:
            part.write_bytes(data)
