"""Reports of parts, without a drop: counts are given."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.text import Text
from rich.console import Console

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.comparison import ComparedResults
from resting_aspects_ros.report.drop_page import drop_page
from resting_aspects_ros.statistics.comparison import DropCounts, compare
from resting_aspects_ros.statistics.distribution import Distribution


@pytest.fixture(scope='session')
def make_report():
    """Make the page of a part with a share of the drops in each aspect, and 3 % in none."""

    def make(part, *, unseen=(), measured=False, **more):
        aspects = find_aspects(part)
        weights = np.array([a.basin_share for a in aspects])
        weights[[k - 1 for k in unseen]] = 0.0
        counts = np.random.default_rng(4).multinomial(970, weights / weights.sum())
        distribution = Distribution(aspects, counts, 20, 10, 0)
        if measured:
            own = DropCounts(distribution.by_class().counts, 20, 10)
            other = DropCounts(own.counts // 2 + 3)
            ids = tuple(range(1, len(own.counts) + 1))
            names, labels = tuple(map(str, ids)), ('simulated', 'by hand')
            found = compare(own, other, np.random.default_rng(1))
            more['measured'] = ComparedResults(ids, names, own, other, found, 'class', labels)
        looks = np.array([10, 30, 100, 300, 1000])
        more.setdefault('history', (looks, np.outer(looks, counts) // 1000))
        page = drop_page(distribution, part, part.name, '1000 drops on a tray', **more)
        return SimpleNamespace(page=page, distribution=distribution, part=part)

    return make


@pytest.fixture(scope='session')
def many_sided(solid, solids):
    """A body with more aspects than a figure has bars, no two alike."""
    return solid(solids.random_sphere(90))


@pytest.fixture(scope='session')
def lines():
    """Return the lines that a terminal of 80 columns shows of a table; no text is cut off."""

    def shown(table):
        console = Console(width=80, force_terminal=False)
        with console.capture() as captured:
            console.print(table)
        found = [line.rstrip() for line in captured.get().splitlines()]
        assert max(map(len, found)) <= 80
        assert '…' not in ''.join(found)
        return found

    return shown


@pytest.fixture(scope='session')
def texts():
    """Return the words of a figure, which must be inside it and must not cover each other."""

    def read(figure):
        figure.draw_without_rendering()
        found = [each for each in figure.findobj(Text) if each.get_visible()]
        boxes = [
            (each.get_text(), each.get_window_extent())
            for each in found
            if each.get_text().strip()
        ]
        assert boxes
        for words, box in boxes:
            assert min(box.x0, box.y0) >= 0, words
            assert box.x1 <= figure.bbox.x1, words
            assert box.y1 <= figure.bbox.y1, words
        for (one, a), (other, b) in combinations(boxes, 2):
            across = min(a.x1, b.x1) - max(a.x0, b.x0)
            high = min(a.y1, b.y1) - max(a.y0, b.y0)
            assert min(across, high) < 2, (one, other)
        return [words for words, _ in boxes]

    return read
