"""A distribution with two uncertainties, with its page."""

from pathlib import Path

from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.studies.propagated_counts import PAGE, PropagatedCounts


class PropagatedResult(PropagatedCounts):
    """Drops under several conditions that a calibration leaves possible.

    Its attributes are those of `PropagatedCounts`.
    """

    def report(self, folder: str | Path) -> Path:
        """Write a page with both intervals of each class; returns its path. OutputError."""
        # These imports take about a second.
        from resting_aspects_ros.studies.propagated_page import propagated_page

        with whole_file(Path(folder) / PAGE) as file:
            file.write_text(propagated_page(self), encoding='utf-8')
        return Path(folder) / PAGE
