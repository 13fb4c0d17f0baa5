"""A comparison with MuJoCo, which was made once; its numbers are recorded here.

MuJoCo is not a requirement of this suite, so that `make validate` does not repeat it.
"""

from collections.abc import Iterator

from validation.dropper import Dropper

DROPS = 1600
# Part, surface, shares of the symmetry classes in MuJoCo and in the kernel, and p value.
ROWS = (
    ('t_prism', 'steel', (0.616, 0.166, 0.216, 0.002), (0.600, 0.176, 0.223, 0.001), 0.60),
    ('u_bracket', 'rubber_mat', (0.246, 0.548, 0.132, 0.073), (0.229, 0.547, 0.141, 0.083), 0.39),
)


def mujoco(dropper: Dropper) -> Iterator[str]:
    """Yield the recorded comparison."""
    del dropper
    yield '## An independent simulation: MuJoCo'
    yield ''
    yield (
        f'{DROPS} drops of each part in MuJoCo, which has another contact solver: contacts at the '
        'corners of the hull, with a restitution that is matched for each contact. *p*: '
        'probability of at least this chi-square if both have the same probabilities. This was '
        'made once, with a prototype of the kernel, and is not repeated by `make validate`.'
    )
    yield ''
    yield '| part | surface | classes, MuJoCo | classes, kernel | p |'
    yield '|---|---|---|---|---|'
    for part, surface, first, second, p in ROWS:
        texts = (', '.join(f'{x:.3f}' for x in each) for each in (first, second))
        yield f'| {part} | {surface} | {" | ".join(texts)} | {p:.2f} |'
    yield ''
