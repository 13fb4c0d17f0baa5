"""What the pages of studies and batches share: pictures of aspects, and designs side by side."""

from typing import Any

from resting_aspects_ros.core.errors import analysis
from resting_aspects_ros.report.aspect_pose import picture_part
from resting_aspects_ros.report.colours import rgb
from resting_aspects_ros.report.page_template import picture_uri
from resting_aspects_ros.report.posed_part import draw_parts, pose_parts
from resting_aspects_ros.report.rounding import shown_difference
from resting_aspects_ros.studies.study_cases import StudyCase
from resting_aspects_ros.studies.study_comparison import CaseComparison
from resting_aspects_ros.studies.study_figures import case_colours

PIXELS = 176


def case_pictures(case: StudyCase) -> list[str]:
    """Return a picture of each symmetry class as a data URI; empty if they cannot be made."""
    members = [alike[0] for alike in case.aspects.classes()]
    found = [''] * len(members)
    with analysis(f'the pictures of {case.part.name}'):
        part = picture_part(case.part, case.aspects.aspects)
        colours = [rgb(colour) for colour in case_colours(case)[: len(members)]]
        images = draw_parts(pose_parts(part, members), colours, PIXELS)
        found[:] = [picture_uri(image) for image in images]
    return found


def comparison_texts(found: CaseComparison, pictures: dict[int, list[str]]) -> dict[str, Any]:
    """Return the texts of two designs side by side; pictures by id(case)."""
    first, second = found.first, found.second
    points = '{:+.1f} to {:+.1f}'
    return {
        'first': first.name,
        'second': second.name,
        'apart': f'{found.apart:.2g}',
        'rows': [
            {
                'names': (first.class_names[e.first - 1], second.class_names[e.second - 1]),
                'pictures': (
                    pictures[id(first)][e.first - 1],
                    pictures[id(second)][e.second - 1],
                ),
                'shares': (f'{100 * e.first_share:.1f} %', f'{100 * e.second_share:.1f} %'),
                'difference': (
                    f'{100 * shown_difference(e.second_share, e.first_share, 1):+.1f} points'
                ),
                'interval': points.format(100 * e.lower, 100 * e.upper),
                'largest': f'{100 * e.largest:+.1f} points',
                'largest_interval': points.format(100 * e.largest_lower, 100 * e.largest_upper),
                'point': e.point,
            }
            for e in found.shared
        ],
        'alone': [
            f'{case.name}: {", ".join(names)}'
            for case, names in (
                (first, _alone(first, {e.first for e in found.shared})),
                (second, _alone(second, {e.second for e in found.shared})),
            )
            if names
        ],
    }


def _alone(case: StudyCase, shared: set[int]) -> list[str]:
    return [name for k, name in enumerate(case.class_names, 1) if k not in shared]
