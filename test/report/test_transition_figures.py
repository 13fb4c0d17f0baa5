"""The figures of transitions show the numbers, and all words and arrows can be seen."""

import numpy as np
import pytest
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.format import aspect_colour
from resting_aspects_ros.report.transitions import retention_figure, transition_figure
from resting_aspects_ros.statistics.transitions import RetentionCurve, TransitionMatrix


def curves_of(aspects, lift):
    generator = np.random.default_rng(3)
    curves = []
    for aspect in aspects:
        share = 0.95 / (1 + (2 * aspect.min_barrier / lift) ** 3)
        left, parts = generator.binomial(300, share), np.full(len(lift), 300)
        curves.append(RetentionCurve(aspect.id, aspect.min_barrier, lift, left, parts, 0.9))
    return curves


def of_kind(figure, kind):
    """The visible artists of a kind, without the backgrounds of figure and axes."""
    backgrounds = {id(figure.patch), *(id(axes.patch) for axes in figure.axes)}
    return [each for each in figure.findobj(kind) if id(each) not in backgrounds]


def test_heat_map_writes_each_probability_and_interval(part, texts):
    aspects = find_aspects(part('l_bracket'))
    k = len(aspects)
    rows = np.random.default_rng(5).dirichlet(np.full(k, 0.4), k)
    counts = np.zeros((k, k + 4), dtype=np.int64)
    counts[:, :k] = np.random.default_rng(5).multinomial(1000, rows)
    matrix = TransitionMatrix(aspects, counts)
    figure = transition_figure(matrix, part('l_bracket'), 'a kick')
    found = texts(figure)
    shades = [sum(cell.get_facecolor()[:3]) for cell in of_kind(figure, Rectangle)]
    assert len(shades) == k * k
    # Probable cells are darker.
    order = np.argsort(matrix.transitions, axis=None)
    assert (np.diff(np.array(shades)[order]) <= 1e-9).all()
    assert max(shades) > min(shades)
    assert len(of_kind(figure, AxesImage)) == 2 * k  # both axes
    assert found.count('1') == 2
    assert found.count('1 000 actions') == k
    numbers = [
        float(words) for words in found if '.' in words and words.replace('.', '').isdigit()
    ]
    shares = matrix.transitions[matrix.transitions > 0]
    assert sorted(numbers) == pytest.approx(sorted(100 * shares), abs=0.051)
    assert sum('–' in words for words in found) == k * k


def test_retention_has_a_line_for_each_class_with_its_barrier(part, texts):
    bracket = part('l_bracket')
    aspects = find_aspects(bracket)
    curves = curves_of(aspects, np.geomspace(2e-4, 0.02, 12))
    figure = retention_figure(curves, aspects, bracket, 'a kick')
    found = texts(figure)
    classes = aspects.classes()
    canvas, axes = figure.axes
    lines = [line for line in axes.lines if line.get_linestyle() == '-']
    assert [line.get_color() for line in lines] == [aspect_colour(row[0]) for row in classes]
    barriers = [line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == '--']
    assert barriers == pytest.approx([1000 * row[0].min_barrier for row in classes])
    assert len(axes.collections) == len(classes)  # bands
    assert len(canvas.images) == len(classes)
    assert axes.get_xscale() == 'log'
    for row in classes:
        assert f'barrier {1000 * row[0].min_barrier:#.3g} mm' in found
    assert any('90 % intervals' in words.replace('\n', ' ') for words in found)


def test_curves_of_a_class_are_added_up(part, texts):
    aspects = find_aspects(part('box_10x20x30'))
    curves = curves_of(aspects, np.linspace(0.001, 0.01, 5))
    figure = retention_figure(curves, aspects, None, 't')
    _, axes = figure.axes
    pooled = (curves[0].left + curves[1].left) / 600
    assert axes.lines[0].get_ydata() == pytest.approx(pooled)
    assert 'aspects 1 and 2' in texts(figure)


@pytest.mark.filterwarnings('error')
def test_curve_without_a_barrier_or_any_loss(part, texts):
    aspects = find_aspects(part('l_bracket'))
    curve = RetentionCurve(1, np.inf, np.array([0.01]), np.array([0]), np.array([50]), 0.95)
    assert 'no barrier' in texts(retention_figure([curve], aspects, None, 't'))
