"""The page of a track with traps."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from resting_aspects_ros.api.pages import part_facts, run_facts
from resting_aspects_ros.report.page import (
    Chart,
    Fold,
    Item,
    Page,
    Section,
    Text,
    file_names,
    reading,
)
from resting_aspects_ros.simulation.conditions import quantities_of
from resting_aspects_ros.tracks.description import Track
from resting_aspects_ros.tracks.show import flow_figure, track_figure
from resting_aspects_ros.tracks.traps import value_text

if TYPE_CHECKING:
    from resting_aspects_ros.api.track_result import TrackResult

PAGE, FIGURES = 'track.html', ('orientations', 'track', 'flow')
MANY_ROWS = 12  # a longer table of the traps is shown on request


def track_page(result: 'TrackResult') -> Page:
    """Return the page: orientations, the track to scale, outcomes, and where the parts go."""
    found, names, covered = result.passage, result.trap_names, result.drop.range_text
    rows, *of_traps = result.tables()
    rows.title = ''
    rows.caption = f'{rows.caption} {covered}'.rstrip()
    sections = [
        Section(
            'Orientations on the track',
            'orientations',
            [
                Chart(
                    'orientations',
                    'Each orientation from above at the wall, with its contact and its centre of '
                    'mass',
                    result.figure,
                    'From above; the wall is the thick line, and parts move to the right. Blue: '
                    'where the part touches the track. Dashed: the region that the narrowest part '
                    'of the track supports, in which the centre of mass, the cross, has to be. '
                    'The margin is that of the trap that stops the row, or the least one.',
                    result.figure,
                ),
                rows,
            ],
        )
    ]
    if names:
        draw = partial(track_figure, found.track.surface.width, names, result.cuts())
        flow = partial(flow_figure, found, names)
        long = len(rows.rows) > MANY_ROWS
        items: list[Item] = [
            Chart(
                'track',
                'The track from above with its traps, to scale',
                partial(draw, result.wanted_outline()),
                'To scale, from above, with the first wanted orientation before the traps.',
                partial(draw, result.wanted_outline()),
            ),
            *([Fold('what each trap does to each row', of_traps[:1])] if long else of_traps[:1]),
            *of_traps[1:],
            Chart(
                'flow',
                'Share of the parts before and after each trap, by row',
                flow,
                'The height of a band is a share of the parts, and its number a row. Below are '
                'the parts that leave the track; grey is what statics does not tell.',
                flow,
            ),
        ]
        sections.append(Section('Traps', 'traps', items))
    run = result.drop.run
    return Page(
        file=PAGE,
        title=run.part,
        topic='track',
        lead='What passes the traps of the track',
        subtitle=result.title.split('\n')[0],
        sections=sections,
        reading=reading('track'),
        facts={
            'Part': part_facts(result.part, run, result.drop.distribution.aspects),
            'Track': list(_track_facts(found.track)),
            'Run': run_facts(run, result.drop.distribution.drops, 'drops'),
        },
        top=verdicts(result.sentences, covered),
        names=file_names(PAGE, FIGURES),
    )


def verdicts(sentences: Sequence[str], covered: str) -> list[Item]:
    """Return the sentences at the top of the page: without what the model range covers."""
    return [Text(sentence, 'verdict') for sentence in sentences if sentence != covered]


def _track_facts(track: Track) -> Iterator[tuple[str, str]]:
    """Yield label and value of each dimension of a track: mm and degrees."""
    for of in (track.surface, track.wall, track):
        for name, each in quantities_of(of).items():
            label = each.label if name not in ('friction', 'height') else each.text
            yield label, value_text(getattr(of, name), each.unit)
