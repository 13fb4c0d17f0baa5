"""The result of a run of drops, with its picture and report."""

from pathlib import Path

from resting_aspects_ros.api.counted_run import CountedRun
from resting_aspects_ros.api.output_files import whole_file


class DropResult(CountedRun):
    """The distribution of a run, with the run, its part and its poses.

    Its attributes are those of `CountedRun`.
    """

    def report(self, folder: str | Path) -> Path:
        """Write a page with pictures and charts into a folder, which is made if necessary.

        Returns the path of the page; raises OutputError if it cannot be written.
        """
        # This import takes about a second.
        from resting_aspects_ros.api.report_files import check_report, write_report

        check_report('folder', Path(folder))
        return write_report(self, Path(folder))

    def save_picture(self, path: Path) -> None:
        """Write the picture as PNG; raises OutputError."""
        # These imports take about a second.
        from resting_aspects_ros.report.figure_style import png_bytes
        from resting_aspects_ros.report.picture import distribution_figure

        figure = distribution_figure(self.distribution, self.part, self.title)
        with whole_file(path) as part:
            part.write_bytes(png_bytes(figure))
