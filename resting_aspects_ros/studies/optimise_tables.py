"""Tables of the result of `optimise`: the conditions that are compared, and the factors."""

from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from resting_aspects_ros.api.surroundings import conditions_text
from resting_aspects_ros.studies.design import Factor

if TYPE_CHECKING:
    from resting_aspects_ros.studies.optimum import Candidate, Optimum


def candidate_table(result: 'Optimum') -> Table:
    """Return the table of the conditions that are compared."""
    base = conditions_text(result.best.setting.drop_conditions)
    if result.start is not None:
        base = conditions_text(result.start.setting.drop_conditions)
    table = Table(title=f'{result.part.name}: {result.aim}\nyour conditions: {base}')
    table.add_column('conditions')
    for factor in result.factors:
        table.add_column(factor.label or factor.name, justify='right')
    table.add_column('entropy' if result.objective.is_entropy else 'share', justify='right')
    table.add_column(f'{100 * result.confidence:g} % interval', justify='right')
    table.add_column('fresh drops', justify='right')
    for name, candidate in (
        ('best' if result.winner else 'best, no winner', result.best),
        ('second', result.second),
        ('yours', result.start),
    ):
        if candidate is not None:
            table.add_row(name, *_cells(candidate, result))
    return table


def factor_table(result: 'Optimum') -> Table:
    """Return the table of the factors: range, flat range and effect."""
    table = Table(title='what the factors do')
    table.add_column('factor')
    table.add_column('searched', justify='right')
    within = result.objective.difference(result.objective.tolerance)
    table.add_column(f'within {within.replace("1.0 points", "1 point")}', justify='right')
    table.add_column('effect, at most', justify='right')
    for factor, facts in zip(result.factors, result.facts, strict=True):
        table.add_row(
            factor.label or factor.name,
            _span(factor, factor.low, factor.high),
            _span(factor, *factor.values(np.array(facts.flat)).tolist()),
            ''
            if np.isnan(facts.effect_upper)
            else result.objective.difference(facts.effect_upper),
        )
    return table


def _cells(candidate: 'Candidate', result: 'Optimum') -> list[str]:
    number, value = result.objective.number, candidate.estimate
    values = [candidate.values[factor.name] for factor in result.factors]
    return [
        *(
            '' if v is None else factor.text(v)
            for v, factor in zip(values, result.factors, strict=True)
        ),
        number(value.value),
        f'{number(value.lower).split()[0]} to {number(value.upper)}',
        str(candidate.drops),
    ]


def _span(factor: Factor, low: float, high: float) -> str:
    return f'{factor.text(low)} to {factor.text(high)}'
