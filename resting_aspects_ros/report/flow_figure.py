"""The flow graph of a repeated action: how many parts move between which aspects."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.aspect_groups import (
    Group,
    aspect_groups,
    group_images,
    membership,
)
from resting_aspects_ros.report.figure_style import PAPER, TEXT
from resting_aspects_ros.report.flow_layout import arrow_outline, node_places
from resting_aspects_ros.report.pixel_axes import Header, draw_image, pixel_axes
from resting_aspects_ros.report.posed_part import Image
from resting_aspects_ros.report.rounding import share_text
from resting_aspects_ros.statistics.markov import LongRun
from resting_aspects_ros.statistics.transitions import TransitionMatrix

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a figure is made
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MIN_FLOW = 0.005  # smaller flows have no arrow
# Sizes in pixels. NODE is the radius of a node, PICTURE the side of the picture in it.
NODE, PICTURE = 78, 104
NODE_OF_MANY, PICTURE_OF_MANY, MANY = 66, 86, 8
BESIDE = 190  # room for the texts beside the circle
ABOVE = 76  # and above and below it
MAX_ARROW = 30  # width of the widest arrow


@dataclass(frozen=True, eq=False)
class Flows:
    """The flows between groups of aspects, as shares of all parts in one action.

    groups : sequence of Group
    shares : (g,) float
        Long-run share of each group.
    flow : (g, g) float
        From row to column: the sum of share times transition probability.
    stays : (g,) float
        Probability that an action leaves a part in its group; NaN if it is not known.
    """

    groups: Sequence[Group]
    shares: Array
    flow: Array
    stays: Array

    @property
    def arrows(self) -> list[tuple[int, int]]:
        """Start and end of each arrow, the widest flow first."""
        g = len(self.groups)
        pairs = [(i, j) for i in range(g) for j in range(g) if i != j]
        drawn = [pair for pair in pairs if self.flow[pair] >= MIN_FLOW]
        return sorted(drawn, key=lambda pair: -self.flow[pair])

    @property
    def omitted(self) -> list[float]:
        """The flows between different groups that are too small for an arrow, but not zero."""
        between = self.flow[~np.eye(len(self.groups), dtype=bool)]
        return between[(between > 0) & (between < MIN_FLOW)].tolist()


def flows(matrix: TransitionMatrix, long_run: LongRun) -> Flows:
    """Return the flows between aspects, or between classes if there are many aspects.

    See aspect_groups. Rows without actions have no flow.
    """
    groups = aspect_groups(matrix.aspects, long_run.shares)
    member = membership(groups, len(matrix.aspects))
    shares = member @ long_run.shares
    flow = long_run.shares[:, None] * np.nan_to_num(matrix.transitions)
    inside = (matrix.transitions * (member.T @ member)).sum(axis=1)
    # The aspects of a group without any parts have equal weights.
    weights = np.where(member.T @ shares > 0, long_run.shares, 1.0)
    stays = [np.average(inside[row > 0], weights=weights[row > 0]) for row in member]
    return Flows(groups, shares, member @ flow @ member.T, np.array(stays))


def flow_figure(
    matrix: TransitionMatrix, long_run: LongRun, part: Part | None, title: str
) -> 'Figure':
    """Plot the flow between the aspects in the long run as arrows between nodes on a circle.

    The width of an arrow is proportional to the flow, which is the long-run share of the start
    times the transition probability. Flows below 0.5 % have no arrow, which the figure states with
    their sum. A node shows the aspect, the probability to stay, and beside it the long-run share.
    If there are more than 12 aspects, nodes are symmetry classes; if there are also more than 12
    classes, those with the smallest shares have one node together.

    Parameters
    ----------
    matrix : TransitionMatrix
        By aspect.
    long_run : LongRun
        By aspect.
    part : Part or None
        Without the part, the nodes have no pictures.
    title : str
        Without a title, the figure has no explanation either; see flow_note.
    """
    from matplotlib.patches import Polygon

    found = flows(matrix, long_run)
    g = len(found.groups)
    node, picture = (NODE, PICTURE) if g <= MANY else (NODE_OF_MANY, PICTURE_OF_MANY)
    places, angles = node_places(g, node)
    width = 2 * round(np.abs(places[:, 0]).max(initial=0.0) + node + BESIDE)
    header = Header(title, flow_note(matrix, long_run) if title else '', width)
    above, below = (
        round(ends.max(initial=0.0) + node + ABOVE) for ends in (places[:, 1], -places[:, 1])
    )
    figure, axes = pixel_axes(width, header.height + above + below)
    header.draw(axes)
    places = places + np.array([width / 2, below])
    scale = MAX_ARROW / max((found.flow[pair] for pair in found.arrows), default=1.0)
    for i, j in found.arrows:
        outline = arrow_outline(places, i, j, node, found.flow[i, j] * scale)
        colour = found.groups[i].colour
        axes.add_patch(
            Polygon(outline, facecolor=colour, edgecolor=PAPER, linewidth=0.6, alpha=0.85)
        )
    for k, image in enumerate(group_images(part, found.groups, picture)):
        _draw_node(axes, found, k, places[k], node, image)
        _write_beside(axes, found, k, places[k], node, float(angles[k]))
    return figure


def flow_note(matrix: TransitionMatrix, long_run: LongRun) -> str:
    """Return the text that explains the figure, in one to three lines."""
    found = flows(matrix, long_run)
    left = float(long_run.shares @ np.nan_to_num(matrix.left))
    about = (
        'Beside each aspect is its long-run share. The width of an arrow is the share of all '
        'parts that moves this way in one action (long-run share times transition probability)'
    )
    if found.arrows:
        about += f'; the widest is {share_text(float(found.flow[found.arrows[0]]))} %'
    lines = [f'{about}.']
    if found.omitted:
        many = len(found.omitted)
        lines.append(
            f'{many} flow{"s" * (many > 1)} below {100 * MIN_FLOW:g} %, together '
            f'{share_text(sum(found.omitted))} %, {"have" if many > 1 else "has"} no arrow.'
        )
    if left > 0:
        lines.append(
            f'In one action {share_text(left)} % of all parts leave the aspects and are replaced '
            'by dropped parts, without an arrow.'
        )
    return '\n'.join(lines)


def _draw_node(
    axes: 'Axes', found: Flows, k: int, place: Array, node: float, image: Image | None
) -> None:
    """Draw the circle of a node, and in it the picture and the probability to stay."""
    from matplotlib.patches import Circle

    group, (x, y) = found.groups[k], place.tolist()
    circle = Circle((x, y), node, facecolor=PAPER, edgecolor=group.colour, linewidth=1.6, zorder=2)
    axes.add_patch(circle)
    if image is not None:
        draw_image(axes, image, x, y + 0.16 * node)
    if np.isnan(found.stays[k]):
        return
    text = f'{"stays" if group.alike else "among them"}\n{share_text(float(found.stays[k]))} %'
    # Below the picture, or in the centre.
    below, va = (0.86 * node, 'bottom') if image is not None else (0.0, 'center')
    axes.text(
        x, y - below, text, size=7, color=TEXT, ha='center', va=va, linespacing=1.0, zorder=4
    )


def _write_beside(
    axes: 'Axes', found: Flows, k: int, place: Array, node: float, angle: float
) -> None:
    """Write the name and the long-run share of a node on the far side of the centre."""
    group = found.groups[k]
    x, y = place + (node + 12) * np.array([math.cos(angle), math.sin(angle)])
    ha = 'center' if abs(math.cos(angle)) < 0.3 else 'left' if math.cos(angle) > 0 else 'right'
    va = 'center' if abs(math.sin(angle)) < 0.3 else 'bottom' if math.sin(angle) > 0 else 'top'
    text = f'{textwrap.fill(group.title, 14)}\n{share_text(float(found.shares[k]))} %'
    axes.text(x, y, text, size=9, weight='bold', color=TEXT, ha=ha, va=va, zorder=4)
