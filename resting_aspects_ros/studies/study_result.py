"""The result of a study, with its page."""

from pathlib import Path

from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.studies.study_counts import PAGE, StudyCounts


class StudyResult(StudyCounts):
    """The counts of a study, and what they depend on.

    Its attributes are those of `StudyCounts`.
    """

    def report(self, folder: str | Path) -> Path:
        """Write a page with curves, indices and findings; returns its path. OutputError."""
        # This import takes about a second.
        from resting_aspects_ros.studies.study_page import study_page

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        with whole_file(folder / PAGE) as part:
            part.write_text(study_page(self), encoding='utf-8')
        return folder / PAGE
