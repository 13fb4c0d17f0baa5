"""Batches of parts: what is known before the first drop."""

import pytest

import resting_aspects_ros as ra


def test_missing_parts_are_named_before_the_first_drop(tmp_path, here):
    """The first part is checked after the warnings, and before it is simulated."""
    noticed = []
    with pytest.warns(ra.RestingAspectsWarning) as caught:
        batch = ra.drop_batch(
            ['tetrahedron', 'tetrahedrn', tmp_path / 'absent.stl'],
            20,
            check=lambda _: noticed.extend(str(each.message) for each in caught),
            workers=here(),
        )
    assert len(noticed) == 2
    assert noticed[0].startswith("tetrahedrn: part 'tetrahedrn' is not known")
    assert noticed[1].endswith("absent.stl' does not exist")
    assert [bool(entry.error) for entry in batch.entries] == [False, True, True]
    assert batch.entries[0].result.distribution.drops == 20
