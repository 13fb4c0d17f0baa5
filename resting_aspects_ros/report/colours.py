"""One colour for each aspect, the same in every picture; aspects that look alike share one."""

from resting_aspects_ros.core.aspects.aspect_set import Aspect

# The first seven are Okabe and Ito's (2008). Any two, and the grey, differ by more than 10 in
# CIELAB also to people who see no red or no green.
COLOURS = (
    '#0072B2',
    '#E69F00',
    '#009E73',
    '#D55E00',
    '#56B4E9',
    '#CC79A7',
    '#F0E442',
    '#882255',
    '#B9D98B',
    '#4A3FD0',
)
GREY = '#B8B8B8'  # what is in no aspect


# The second ten are these made lighter, the third darker, and so on: towards which, and how far.
_ROUNDS = ((0.0, 0.0), (1.0, 0.5), (0.0, 0.4))


def aspect_colour(aspect: Aspect) -> str:
    """'#RRGGBB', by symmetry class; they repeat after three times ten."""
    turn, k = divmod(aspect.symmetry_class - 1, len(COLOURS))
    towards, far = _ROUNDS[turn % len(_ROUNDS)]
    mixed = [round(255 * (c + (towards - c) * far)) for c in rgb(COLOURS[k])]
    return '#{:02X}{:02X}{:02X}'.format(*mixed)


def rgb(colour: str) -> tuple[float, float, float]:
    """Red, green and blue of '#RRGGBB', 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue
