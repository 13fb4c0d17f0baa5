"""The colour of each symmetry class, the same in every picture."""

from resting_aspects_ros.aspects.aspect_set import Aspect

# The first seven are from Okabe and Ito (2008). Any two of these colours, and the grey, differ by
# more than 10 in CIELAB, also for viewers with red or green colour blindness.
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
GREY = '#B8B8B8'  # for drops in no aspect


# After the ten colours follow ten lighter and ten darker ones: white or black, and its share.
_SHADES = ((0.0, 0.0), (1.0, 0.5), (0.0, 0.4))


def aspect_colour(aspect: Aspect) -> str:
    """Return the colour of the aspect's symmetry class as '#RRGGBB'; 30 colours repeat."""
    shade, k = divmod(aspect.symmetry_class - 1, len(COLOURS))
    target, share = _SHADES[shade % len(_SHADES)]
    mixed = [round(255 * (c + (target - c) * share)) for c in rgb(COLOURS[k])]
    return '#{:02X}{:02X}{:02X}'.format(*mixed)


def rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of '#RRGGBB', each from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue
