"""What the result of `optimise` says in sentences."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from resting_aspects_ros.studies.design import Factor
from resting_aspects_ros.studies.objectives import Objective, listed
from resting_aspects_ros.studies.optimum_comparison import Advantage
from resting_aspects_ros.studies.optimum_facts import FactorFacts

if TYPE_CHECKING:
    from resting_aspects_ros.studies.optimum import Optimum

# Values that belong to a pair of materials.
MATERIAL = ('restitution', 'friction', 'rolling_friction', 'spinning_friction')
# An answer with at least this probability is a finding.
SHOWN = 0.95


def optimise_notes(result: 'Optimum') -> list[str]:
    """Return what the result says, the most important first."""
    return [
        *_comparisons(result),
        *_bounds(result),
        *_without_effect(result),
        *_materials(result),
        *_limits(result),
    ]


def certainty_text(certainty: float) -> str:
    """Return a probability as text; it is never rounded to 0 or 100 %."""
    if certainty > 0.999:
        return 'more than 99.9 %'
    return 'less than 0.1 %' if certainty < 0.001 else f'{100 * certainty:.1f} %'


def _comparisons(result: 'Optimum') -> Iterator[str]:
    if result.complete and not result.winner:
        yield (
            'No winner: the probability that the best conditions are better than all others that '
            f'were compared is {certainty_text(result.certainty)}.'
        )
    if result.best is result.start:
        yield 'Your conditions have the best value of those that were compared.'
    if result.over_second is not None:
        yield _against(result.over_second, result.objective, 'the second conditions')
    if result.over_start is not None:
        yield _against(result.over_start, result.objective, 'your conditions')
    if result.over_second is not None or result.over_start is not None:
        yield (
            f'These values are from {result.best.drops} fresh drops for each of the conditions. '
            'The drops that selected the best conditions are not among them, so that the values '
            'are not those of the luckiest point.'
        )


def _against(found: Advantage, objective: Objective, other: str) -> str:
    """Return how the best conditions compare with others."""
    low, high = found.gain.lower, found.gain.upper
    certainty = certainty_text(found.certainty)
    if found.certainty >= SHOWN and low > 0:
        span = f'{objective.difference(low).split()[0]} to {objective.difference(high)}'
        return (
            f'The best conditions are better than {other} by {span}; the probability that they '
            f'are better at all is {certainty}.'
        )
    if found.certainty < 1 - SHOWN and high < 0:
        span = f'{objective.difference(-high).split()[0]} to {objective.difference(-low)}'
        return (
            f'{other[0].upper()}{other[1:]} are better than the best ones in the ranges by {span}.'
        )
    return (
        f'No difference is shown between the best conditions and {other}: it is at most '
        f'{objective.difference(max(high, -low))}, and the probability that the best ones are '
        f'better is {certainty}.'
    )


def _bounds(result: 'Optimum') -> Iterator[str]:
    for factor, facts in zip(result.factors, result.facts, strict=True):
        if not facts.at_bound:
            continue
        end, value = ('lower', factor.low) if facts.bound < 0 else ('upper', factor.high)
        quantity = result.best.setting.quantity(factor.name)
        if value == (quantity.low if facts.bound < 0 else quantity.high):
            yield (
                f'The best {factor.name} is at the {end} bound that is possible at all, '
                f'{factor.text(value)}.'
            )
        else:
            yield (
                f'The best {factor.name} is at the {end} bound of its range, '
                f'{factor.text(value)}: widen the range, it may be better beyond.'
            )


def _without_effect(result: 'Optimum') -> Iterator[str]:
    """Yield which factors do not matter, or have no effect that can be shown."""
    tolerance, pairs = result.objective.tolerance, zip(result.factors, result.facts, strict=True)
    known = [(factor.name, facts) for factor, facts in pairs]
    small = [(name, f) for name, f in known if f.effect_upper <= tolerance]
    hidden = [(name, f) for name, f in known if f.effect_upper > tolerance and not f.matters]
    if small:
        verb = 'does' if len(small) == 1 else 'do'
        yield _at_most(result, small, f'{verb} not matter here')
    if hidden:
        verb = 'has' if len(hidden) == 1 else 'have'
        yield _at_most(result, hidden, f'{verb} no effect that can be shown')


def _at_most(result: 'Optimum', found: list[tuple[str, FactorFacts]], statement: str) -> str:
    names = listed([name for name, _ in found])
    most = result.objective.difference(max(facts.effect_upper for _, facts in found))
    return f'{_at_start(names)} {statement} within the given ranges: {most} at most.'


def _materials(result: 'Optimum') -> Iterator[str]:
    names = [factor.name for factor in result.factors if is_material(factor)]
    if names:
        verb, them = ('is a property', 'it') if len(names) == 1 else ('are properties', 'them')
        yield (
            f'{_at_start(listed(names))} {verb} of the materials of part and surface: another '
            f'surface is needed to change {them}.'
        )


def _at_start(names: str) -> str:
    """Return names of factors as they begin a sentence; those with a dot are kept as they are."""
    return names if '.' in names else names[0].upper() + names[1:]


def is_material(factor: Factor) -> bool:
    """Return whether a factor is a property of the materials."""
    return factor.name.rpartition('.')[2] in MATERIAL


def _limits(result: 'Optimum') -> Iterator[str]:
    if result.skipped:
        yield (
            f'{len(result.skipped)} points were impossible and were skipped, the first because: '
            f'{result.skipped[0][1]}.'
        )
    if result.start is None and result.complete:
        yield 'Your conditions are impossible themselves, and were not compared.'
    if not result.complete:
        yield (
            f'The search ended early, after {result.drops} of {result.amounts.total} drops, '
            'without the fresh drops that confirm the best conditions: their value is that of '
            'the surrogate, and is probably too good.'
        )
    elif not result.certain:
        yield (
            'The budget was used before the search was certain that no other conditions are '
            'better by a notable difference; a larger budget continues it.'
        )
