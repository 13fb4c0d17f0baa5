"""How an action brings the part from aspect to aspect, and the best plan."""

from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.api.reorient import reorient
from resting_aspects_ros.api.reorient_result import PlanResult, ReorientResult, plan_reorientation
from resting_aspects_ros.api.reorientation_files import reorientation_page
from resting_aspects_ros.report.page import Item, Text
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.studio.recipe import reorient_options, reorient_recipe
from resting_aspects_ros.studio.rows import Opened
from resting_aspects_ros.studio.settings import Settings, action_sliders
from resting_aspects_ros.studio.work import Work, controls_html

NOTHING_PICKABLE = (
    'Mark a class as pickable in the tab Aspects to see the best plan that leads to it.'
)


def controls(settings: Settings, opened: Opened) -> str:
    """Return the choice of the action and the sliders of its values."""
    del opened
    names = shipped_actions().names()
    return controls_html('action', actions=names, sliders=action_sliders(settings.action))


def show(work: Work) -> None:
    """Simulate the action and show its transitions, and then the plan."""
    work.publish('same', {'text': reorient_recipe(work.opened.source, work.settings).line})
    result = reoriented(work, work.settings.action)
    if work.stopped():
        return
    _show_page(work, result, None)
    wanted = _pickable_ids(work)
    if not wanted or not result.complete:
        return
    names = sorted(work.settings.plan - {result.action.name})
    results = [result, *(reoriented(work, shipped_actions().get(name)) for name in names)]
    if not work.stopped():
        _show_page(work, result, plan_reorientation(results, wanted))


def reoriented(work: Work, action: NamedAction) -> ReorientResult:
    """Return the transitions of an action on the part, made once."""
    options = reorient_options(work.settings)
    key = ('reorient', work.opened.part.part_sha256, repr(action), *map(repr, options.values()))
    return work.keep(
        key,
        lambda: reorient(
            work.opened.part, action, **options, **work.options(f'actions of {action.name}')
        ),
    )


def _pickable_ids(work: Work) -> list[int]:
    classes = work.opened.aspects.classes()
    return [aspect.id for k in sorted(work.settings.pickable) for aspect in classes[k - 1]]


def _show_page(work: Work, result: ReorientResult, plan: PlanResult | None) -> None:
    wanted = _pickable_ids(work)
    page = reorientation_page([result], wanted=wanted, plan=plan)
    items: list[Item] = [Text(note, 'note') for note in page.notes]
    if not wanted:
        items.append(Text(NOTHING_PICKABLE, 'plain'))
    for section in reversed(page.sections):  # the plan first
        items += [Text(section.heading, 'part'), *section.items]
    work.show('reorientation', items)
