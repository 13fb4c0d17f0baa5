"""The convex pieces with which parts are simulated in surroundings."""

from resting_aspects_ros.api.conditions import (
    pieces_text,
    simulated_pieces,
    with_surroundings,
)


def test_pieces_are_known_where_more_than_planes_meet_the_part(part, surfaces):
    shape, rubber = part('tetrahedron'), surfaces.get('rubber_mat')
    assert simulated_pieces(shape, with_surroundings(rubber, 'l_chute')) is None
    for name in ('bowl_track', 'pocket'):
        pieces = simulated_pieces(shape, with_surroundings(rubber, name))
        assert len(pieces.corners) == 1
        assert pieces_text(pieces, 'The edge meets').startswith('The edge meets the part as 1 con')
